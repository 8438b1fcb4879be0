"""Segments of films: against cuts by hand, and against the sets that `gril subtasks` writes."""

import io

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.stages import put_inside
from gril_jax.experiments.stage_rewards import segments
from gril_jax.experiments.subtasks import ends as stage_ends
from support.kinematic_demos import GOAL, ROBOT, SQUARE, STAR, kinematic_demos

from gril_jax.demos.demo_set import Demo, demo_batch, load_demo_set, save_demo_set
from gril_jax.demos.vision.detect import Tracks
from gril_jax.runs.progress import Progress

ENDS = np.array([[20, 40], [33, 60], [25, 50]])


@pytest.fixture(scope="module")
def films():
    return jax.device_put(kinematic_demos(0, 3))


def _bits(films):
    rng = np.random.default_rng(0)
    return jax.device_put(rng.random(films.center.shape[:3]) < 0.5)


def test_segments_are_those_that_are_cut_by_hand(films):
    bits = _bits(films)
    first, last = segments.cut(films, bits, ENDS)
    for b in range(3):
        spans = (0, ENDS[b, 0]), (ENDS[b, 0], int(films.length[b]) - 1)
        for part, (begin, end) in zip((first, last), spans, strict=True):
            count = end - begin + 1
            assert part.films.length[b] == count
            for cut, whole in (
                (part.films.center, films.center), (part.films.size, films.size), (part.bits, bits)
            ):  # fmt: skip
                np.testing.assert_array_equal(cut[b, :count], whole[b, begin : end + 1])
                assert (cut[b, count:] == whole[b, end]).all()


def test_segments_are_those_of_the_sets_that_gril_subtasks_writes(films, tmp_path):
    names = ("goal", "robot", *(f"block {n}" for n in range(5)))
    made = []
    for b, length in enumerate(films.length.tolist()):
        center, size = (np.asarray(x[b, :length]) for x in (films.center, films.size))
        seen = np.ones(center.shape[:2], bool)
        tracks = Tracks(center, size, np.arange(7, dtype=np.int32), seen)
        pictures = np.zeros((length, 16, 16, 3), np.uint8)
        made.append(Demo(f"d{b}", pictures, tracks, 0, "success"))
    about = {"task": "", "half_extent": 1.0, "fps": 8.0, "source": "-", "classes": names}
    save_demo_set(tmp_path / "set", made, **about)
    whole = load_demo_set(tmp_path / "set")
    with Progress(stream=io.StringIO()) as progress:
        stage_ends.write_sets(tmp_path, whole, whole.entries, ENDS, progress)
    for number, part in enumerate(segments.cut(films, _bits(films), ENDS), 1):
        written = demo_batch(load_demo_set(tmp_path / f"subtask-{number}"))
        longest = written.center.shape[1]
        np.testing.assert_array_equal(part.films.length, written.length)
        np.testing.assert_array_equal(part.films.center[:, :longest], written.center)
        np.testing.assert_array_equal(part.films.is_robot, written.is_robot)


def test_a_segment_of_one_frame_is_left_out(films):
    ends = ENDS.copy()
    ends[1, 0] = 0
    first, last = segments.cut(films, _bits(films), ends)
    assert first.films.length.tolist() == [21, 26]
    assert last.films.length[1] == films.length[1]


def test_the_only_stage_is_the_whole_film(films):
    (part,) = segments.cut(films, _bits(films), np.asarray(films.length)[:, None] - 1)
    jax.tree.map(np.testing.assert_array_equal, part.films, films)


def test_true_ends_are_when_one_block_and_then_both_are_inside_for_good(films):
    stages = put_inside((STAR, SQUARE), GOAL, robots=(ROBOT,), half_extent=1.0)
    center, size = np.asarray(films.center), np.asarray(films.size)
    for b, ends in enumerate(segments.true_ends(stages, films, jnp.arange(7))):
        away = np.abs(center[b][:, [STAR, SQUARE]] - center[b][:, [GOAL]])
        inside = (away < size[b][:, [GOAL]] / 2).all(axis=-1)[: films.length[b]]
        expected = sorted(np.flatnonzero(~block)[-1] + 1 for block in inside.T)
        assert ends.tolist() == expected
