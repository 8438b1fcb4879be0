"""Batches of encoder training: frames in order, videos apart, scenes turned as a whole."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.kinematic_demos import kinematic_demos

from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.pretraining import batch
from gril_jax.pretraining.pretrain import Static

SMALL = Static(encoder=EncoderConfig(num_classes=7), num_videos=3, num_frames=6)


@pytest.fixture(scope="module")
def demos():
    return jax.tree.map(jnp.asarray, kinematic_demos(0, 5, num_objects=5))


def test_drawn_frames_are_distinct_sorted_and_from_distinct_videos():
    length = jnp.array([20, 4, 12, 1])
    config = dataclasses.replace(SMALL, num_videos=4)
    for seed in range(5):
        frames, valid, videos = batch.draw(jax.random.key(seed), length, 20, config)
        assert sorted(videos.tolist()) == [0, 1, 2, 3]
        for row, ok, video in zip(frames, valid, videos, strict=True):
            drawn = row[ok].tolist()
            assert drawn == sorted(set(drawn))
            assert len(drawn) == min(6, int(length[video]))
            assert max(drawn) < length[video]


def test_every_frame_is_drawn_in_time():
    length = jnp.array([8, 8])
    config = dataclasses.replace(SMALL, num_videos=2, num_frames=2)
    draw = jax.vmap(batch.draw, (0, None, None, None))
    frames, _, _ = draw(jax.random.split(jax.random.key(0), 200), length, 8, config)
    counts = np.bincount(np.asarray(frames).ravel(), minlength=8)
    assert counts.min() > 0.6 * counts.mean()


def test_turned_scenes_keep_all_distances_and_swap_boxes_with_axes(demos):
    turned = batch.turn(jax.random.key(3), demos)
    apart = [
        jnp.linalg.norm(d.center[:, :, :, None] - d.center[:, :, None], axis=-1)
        for d in (demos, turned)
    ]
    np.testing.assert_allclose(*apart, atol=1e-5)
    from_middle = [jnp.linalg.norm(d.center, axis=-1) for d in (demos, turned)]
    np.testing.assert_allclose(*from_middle, atol=1e-5)
    np.testing.assert_allclose(
        jnp.sort(demos.size, axis=-1), jnp.sort(turned.size, axis=-1), atol=1e-6
    )
    swapped = (turned.size != demos.size).any(axis=(1, 2, 3))
    wide = jnp.abs(jnp.abs(turned.center) - jnp.abs(demos.center)).max(axis=(1, 2, 3)) > 1e-4
    assert 0 < int(wide.sum()) < len(wide)  # some videos have their axes swapped, some not
    assert not bool((swapped & ~wide).any())


def test_a_touched_object_counts_as_moved_from_first_to_last():
    bits = jnp.zeros((200, 4, 3), bool).at[:, 2:, 1].set(True)
    touched = batch.touch(jax.random.key(0), bits, 0.25)
    assert touched[bits].all()  # nothing is taken back
    new = np.asarray(touched & ~bits)[:, 0]
    assert (np.asarray(touched)[:, :2] == np.asarray(touched)[:, :1]).all()
    assert 0.2 < new.mean() < 0.3
    assert not batch.touch(jax.random.key(0), bits, 0.0)[:, 0].any()


def test_places_at_an_edge_lie_around_it_on_both_sides():
    keys = jax.random.split(jax.random.key(0), 4000)
    sides, size = jnp.array([[0.8, 0.4]]), jnp.array([[0.1, 0.1]])
    place = jax.jit(
        jax.vmap(lambda key: batch._at_edge(key, jnp.array([[0.3, -0.2]]), sides, size)[0])
    )(keys)
    beyond = np.abs(np.asarray(place) - [0.3, -0.2]) - np.asarray(sides[0]) / 2
    nearest = np.abs(beyond).min(axis=1)  # of the four lines along the edges
    assert np.quantile(nearest, 0.95) < 2 * 0.9 * 0.05  # two standard deviations
    assert (beyond.max(axis=1) < 0).mean() == pytest.approx(0.5 / 1.1, abs=0.04)  # inside
    assert beyond.max() < 0.9 * 0.05 * 5


def test_rewound_videos_play_as_far_back_as_frames_are_left():
    frames = jnp.array([[0, 2, 5, 6, 8, 9], [1, 3, 4, 6, 10, 11], [4, 20, 21, 22, 23, 24]])
    valid = jnp.arange(6) < jnp.array([[6], [4], [1]])
    turns = set()
    for seed in range(40):
        found = batch.rewound(jax.random.key(seed), frames, valid, 1.0)
        for row, own, ok in zip(found.tolist(), frames.tolist(), valid.tolist(), strict=True):
            count = sum(ok)
            turn = row.index(max(row[:count]))
            turns.add((count, turn))
            back = own[: turn + 1] + own[:turn][::-1]
            assert row == back[:count] + own[count:]
    assert turns == {(6, 3), (6, 4), (6, 5), (4, 2), (4, 3), (1, 0)}
    some = batch.rewound(jax.random.key(0), frames, valid, 0.0)
    np.testing.assert_array_equal(some, frames)
