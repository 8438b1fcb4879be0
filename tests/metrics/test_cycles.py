"""Cycle consistency of nearest neighbours against plain loops over pairs."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.metrics import order as cycles

two_way = jax.jit(cycles.two_way_cycle_consistency)


def _path(seed, num_frames):
    rng = np.random.default_rng(seed)
    path = np.linspace(0, 1, num_frames)[:, None] * np.ones(3)
    return (path + rng.normal(0, 0.1, (num_frames, 3))).astype(np.float32)


def _nearest(query, key):
    return np.array([int(np.argmin([((q - k) ** 2).sum() for k in key])) for q in query])


def _home(videos, route):
    """Frames of the first video that are within one frame of themselves after the route."""
    frames = np.arange(len(videos[route[0]]))
    for u, v in itertools.pairwise(route):
        frames = _nearest(videos[u], videos[v])[frames]
    return np.abs(frames - np.arange(len(frames))) <= 1


@pytest.mark.parametrize("seed", range(3))
def test_it_equals_loops_over_videos_of_unequal_length(seed):
    lengths = [9, 13, 7, 11]
    videos = [_path(10 * seed + k, n) for k, n in enumerate(lengths)]
    padded = np.full((4, 13, 3), np.nan, np.float32)
    for row, frames in zip(padded, videos, strict=True):
        row[: len(frames)] = frames
    arguments = jnp.asarray(padded), jnp.array(lengths)
    pairs = [_home(videos, (u, v, u)).mean() for u, v in itertools.permutations(range(4), 2)]
    np.testing.assert_allclose(two_way(*arguments), np.mean(pairs), rtol=1e-6)
    assert 0 < two_way(*arguments) <= 1


def test_equal_videos_are_consistent_and_a_collapsed_latent_is_not():
    equal = jnp.tile(jnp.asarray(_path(0, 12)), (3, 1, 1))
    assert two_way(equal) == 1
    collapsed = jnp.zeros((3, 12, 2))  # all go to frame 0, which is home for frames 0 and 1
    np.testing.assert_allclose(two_way(collapsed), 2 / 12, rtol=1e-6)


def test_too_few_videos_and_empty_ones_count_for_nothing():
    videos = jnp.stack([jnp.asarray(_path(k, 8)) for k in range(3)])
    assert two_way(videos[:1]) == 0
    lengths = jnp.array([8, 8, 0])
    np.testing.assert_allclose(two_way(videos, lengths), two_way(videos[:2]), rtol=1e-6)
