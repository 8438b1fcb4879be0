"""Stages of demonstrations, from the ways that objects have left."""

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.pretraining import stages
from gril_jax.types import DemoBatch

found = jax.jit(stages.found)


def _demos(paths, length):
    """Videos of a robot that goes round, and two blocks at these places along x (B, T, 2)."""
    paths = np.asarray(paths, np.float32)
    count, frames, _ = paths.shape
    center = np.zeros((count, frames, 3, 2), np.float32)
    center[:, :, 1:, 0] = paths
    center[:, :, 0, 1] = np.sin(np.arange(frames))
    label = jnp.tile(jnp.arange(3), (count, 1))
    boxes, flags = jnp.asarray(center), jnp.ones((count, 3), bool)
    return DemoBatch(boxes, jnp.full_like(boxes, 0.2), label, label == 0, flags, jnp.array(length))


def _ramp(start, end, frames=80):
    return np.clip((np.arange(frames) - start) / (end - start), 0, 1)


def test_two_blocks_that_move_one_after_the_other_are_two_stages():
    paths = [[_ramp(5, 20), _ramp(40, 60)], [_ramp(8, 30), _ramp(45, 66)]]
    demos = _demos(np.moveaxis(np.array(paths), 1, 2), [75, 80])
    made = found(demos)
    for times, (first, last) in zip(made.times, [(20, 60), (30, 66)], strict=True):
        np.testing.assert_allclose(times[0], 0.0)
        assert abs(np.interp(1.0, times, np.arange(80)) - first) <= 2
        assert abs(np.argmax(times >= 2.0) - last) <= 2
        assert (np.diff(times) >= 0).all()
        assert times[-1] == 2.0
    assert (made.proportions > 0).tolist() == [True, True] + [False] * 10
    np.testing.assert_allclose(made.proportions.sum(), 1.0, rtol=1e-5)
    np.testing.assert_allclose(made.proportions[0], np.mean([20 / 60, 30 / 66]), atol=0.03)


def test_videos_in_which_nothing_moves_are_one_stage():
    made = found(_demos(np.zeros((2, 30, 2)), [30, 11]))
    np.testing.assert_allclose(made.times[1, :11], np.arange(11) / 10, rtol=1e-5)
    np.testing.assert_allclose(made.times[1, 10:], 1.0)
    assert made.proportions.tolist() == [1.0] + [0.0] * 11
    assert np.isfinite(np.asarray(found(_demos(np.zeros((2, 1, 2)), [1, 1])).times)).all()


def test_the_way_that_is_left_is_a_share_of_the_whole_and_skips_the_robot():
    demos = _demos(np.stack([np.array([_ramp(0, 10, 11), 0 * _ramp(0, 10, 11)]).T] * 2), [11, 6])
    way = jax.jit(stages.way_left)(demos)
    np.testing.assert_allclose(way[0], -np.linspace(1, 0, 11), atol=1e-6)
    np.testing.assert_allclose(way[1, :6], -np.linspace(1, 0, 6), atol=1e-6)
