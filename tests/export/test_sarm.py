"""Files for SARM and its reward-weighted cloning, as lerobot reads them.

Tests with lerobot itself are skipped where it cannot be imported. For the weights, lerobot 0.4
without its dependencies is enough, with torch, pandas and huggingface_hub.
"""

import importlib
import json

import jax.numpy as jnp
import numpy as np
import pytest
from support.lerobot_sets import STORIES, dataset, indexed, write

from gril_jax.demos.formats import lerobot
from gril_jax.export.lerobot import annotate
from gril_jax.export.lerobot_progress import Trace, write_progress
from gril_jax.subtasks import agreed_boundaries

pytest.importorskip("pyarrow")
NAMES = ["cup down", "spoon in"]
COLUMNS = ["names", "start_times", "end_times", "start_frames", "end_frames"]


def _of_lerobot(*modules):
    """The first of lerobot's modules that can be imported: they have moved between releases."""
    for module in modules:
        try:
            return importlib.import_module(module)
        except ImportError as error:
            missing = error
    return pytest.skip(f"lerobot cannot be imported: {missing}")


def test_weights_of_lerobot_follow_our_progress(tmp_path):
    reader = _of_lerobot("lerobot.rewards.sarm.rabc", "lerobot.utils.rabc")
    made, rows = indexed(tmp_path / "data")
    # Up to frame 10, level to 20, down to 30 and level to the end; episode 0 is not known.
    trace = Trace(np.array([-1.0, -0.5, -0.5, -1.0]), np.array([0.0, 1.0, 2.0, 3.0]))
    out = tmp_path / "sarm_progress.parquet"
    write_progress(made, out, {"episode_000001": trace}, source="run")
    weights = reader.RABCWeights(out, chunk_size=5, fallback_weight=0.25)
    index = np.arange(len(rows))
    found, stats = weights.compute_batch_weights({"index": index})
    found = found.cpu().numpy() / found.max().item()
    assert len(weights.progress_lookup) == len(STORIES[1].boxes)
    begin = len(STORIES[0].boxes)
    np.testing.assert_allclose(found[:begin], 0.25, atol=1e-5)
    own = found[begin:]
    assert (own[:10] == 1).all()  # progress follows
    assert ((own[10:16] > 0) & (own[10:16] < 1)).all()  # none follows
    assert (own[16:30] == 0).all()  # it falls
    assert stats["num_zero_weight"] == 14


def _staircase(*tops):
    """Rewards that rise from -1 in equal steps, over the five frames up to each top."""
    lengths = [len(told.boxes) for told in STORIES]
    trace = np.full((len(lengths), max(lengths)), -1.0, np.float32)
    for own, at in zip(trace, tops, strict=True):
        own[:] = np.interp(
            np.arange(len(own)),
            [0, at[0] - 5, at[0], at[1] - 5, at[1]], [-1.0, -1.0, -0.5, -0.5, 0.0],
        )  # fmt: skip
    return jnp.asarray(trace), jnp.asarray(lengths)


def _annotated(tmp_path, tops):
    """A copy with the segments of a staircase, and its rows of episodes."""
    found = dataset(tmp_path / "data")
    shared = agreed_boundaries(*_staircase(*tops), smoothing=1)
    frames = np.asarray(shared.frames)[:, : int(shared.kept.sum())]
    ends = {f"episode_{n:06d}": (own / 10).tolist() for n, own in enumerate(frames)}
    annotate(found, tmp_path / "new", ends, NAMES)
    made = lerobot.opened(tmp_path / "new")
    return made, lerobot.episodes(made)


def test_segments_of_a_staircase_are_subtask_annotations(tmp_path):
    tops = [(12, 28), (20, 25)]
    made, rows = _annotated(tmp_path, tops)
    for row, (first, second) in zip(rows, tops, strict=True):
        assert [row[f"dense_subtask_{name}"] for name in COLUMNS] == [
            NAMES, [0, first / 10], [first / 10, second / 10], [0, first], [first, second]
        ]  # fmt: skip
    shares = json.loads((made.folder / "meta" / "temporal_proportions_dense.json").read_text())
    assert [*shares] == NAMES
    np.testing.assert_allclose(
        [*shares.values()], [(12 / 28 + 20 / 25) / 2, (16 / 28 + 5 / 25) / 2]
    )
    again = lerobot.opened(made.folder)
    annotate(again, tmp_path / "more", {"episode_000001": [0.5, 1e9]}, NAMES)
    first, second = lerobot.episodes(lerobot.opened(tmp_path / "more"))
    assert first["dense_subtask_names"] is None
    assert second["dense_subtask_end_frames"] == [5, len(STORIES[1].boxes) - 1]
    assert lerobot.episodes(again) == rows


def test_notes_on_columns_do_not_hide_the_annotations(tmp_path):
    """`datasets` takes the features of a file from such a note, where there is one."""
    found = dataset(tmp_path / "data")
    write(lerobot.episode_files(found)[0], lerobot.episodes(found))
    annotate(found, tmp_path / "new", {"episode_000001": [1.0, 2.0]}, NAMES)
    (file,) = lerobot.episode_files(lerobot.opened(tmp_path / "new"))
    assert b"huggingface" not in (lerobot.parquet().read_schema(file).metadata or {})


def test_sarm_of_lerobot_has_each_frame_in_its_segment(tmp_path):
    reader = _of_lerobot("lerobot.rewards.sarm.sarm_utils", "lerobot.policies.sarm.sarm_utils")
    made, rows = _annotated(tmp_path, [(12, 28), (20, 25)])
    shares = json.loads((made.folder / "meta" / "temporal_proportions_dense.json").read_text())
    for row, index in zip(rows, lerobot.frames(made, "subtask_index").values(), strict=True):
        own = [row[f"dense_subtask_{name}"] for name in ("names", "start_frames", "end_frames")]
        seen = [
            reader.find_stage_and_tau(t, row["length"], *own, [*shares], shares)
            for t in range(row["length"])
        ]
        assert [stage for stage, _ in seen] == index
        assert [seen[end][1] for end in own[2]] == [1.0, 1.0]
