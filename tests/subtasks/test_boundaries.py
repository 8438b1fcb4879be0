"""Boundaries on made-up staircases whose stages are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.ndimage
import scipy.signal

from gril_jax import subtasks
from gril_jax.errors import ConfigError
from gril_jax.subtasks.agreement import running_median

transitions = jax.jit(subtasks.transitions, static_argnames=("smoothing", "patience"))


def _staircase(heights, *, flat=20, rise=12, noise=0.0, seed=0):
    """Flat, rise, flat, rise, ... from -sum(heights) to 0; also the frames where rises end."""
    level, trace, ends = -sum(heights), [], []
    for height in heights:
        trace += [level] * flat
        trace += list(level + height * np.arange(1, rise + 1) / rise)
        level += height
        ends.append(len(trace) - 1)
    trace += [level] * flat
    trace = np.array(trace) + np.random.default_rng(seed).normal(0, noise, len(trace))
    return jnp.asarray(trace, jnp.float32), ends


def _frames(mask):
    return np.flatnonzero(np.asarray(mask)).tolist()


@pytest.mark.parametrize("heights", [[1.0], [0.5, 0.5], [0.2, 0.1, 0.7], [0.25] * 4])
def test_boundaries_are_the_ends_of_the_rises(heights):
    trace, ends = _staircase(heights)
    found = _frames(transitions(trace, prominence=0.08))
    assert len(found) == len(ends)
    assert np.abs(np.subtract(found, ends)).max() <= 1


@pytest.mark.parametrize("seed", range(5))
def test_boundaries_survive_noise(seed):
    trace, ends = _staircase([0.4, 0.2, 0.4], noise=0.01, seed=seed)
    found = _frames(transitions(trace))
    assert len(found) == 3
    assert np.abs(np.subtract(found, ends)).max() <= 3


def test_a_jump_is_a_rise_too():
    trace, ends = _staircase([0.5, 0.5], rise=1)
    assert _frames(transitions(trace)) == ends


def test_a_dip_before_a_rise_and_a_single_spike_make_no_boundary():
    trace, ends = _staircase([0.5, 0.5])
    dipped = np.array(trace)
    dipped[50:54] -= 0.05
    dipped[10] += 0.4
    assert len(_frames(transitions(dipped))) == len(ends)


def test_a_short_pause_does_not_split_a_rise_and_a_long_one_does():
    for pause, count in ((4, 1), (15, 2)):
        trace, _ = _staircase([0.5, 0.5], flat=pause)
        padded = np.pad(trace, 20, mode="edge")
        assert len(_frames(transitions(padded, patience=8))) == count


def test_a_rise_that_stands_at_the_end_needs_no_plateau():
    trace, ends = _staircase([0.5, 0.5])
    found = _frames(transitions(trace[: ends[-1] + 1]))
    assert len(found) == 2
    assert found[-1] >= ends[-1] - 2


def test_flat_falling_and_single_frame_traces_have_no_boundary():
    for trace in (np.zeros(50), np.linspace(0, -1, 50), np.zeros(1)):
        assert not transitions(trace.astype(np.float32)).any()


def test_boundaries_scale_with_the_reward():
    trace, _ = _staircase([0.4, 0.2, 0.4], noise=0.01)
    scaled = transitions(8 * trace, prominence=0.8)
    np.testing.assert_array_equal(scaled, transitions(trace, prominence=0.1))


def test_vmap_of_jit_equals_a_loop_of_plain_calls():
    traces = np.stack([_staircase([0.5, 0.5], noise=0.01, seed=s)[0] for s in range(3)])
    batched = jax.vmap(transitions)(traces)
    for trace, mask in zip(traces, batched, strict=True):
        np.testing.assert_array_equal(mask, subtasks.transitions(jnp.asarray(trace)))


def test_padding_with_the_last_value_makes_no_boundary():
    trace, _ = _staircase([0.5, 0.5])
    padded = np.pad(trace, (0, 40), mode="edge")
    assert _frames(transitions(padded)) == _frames(transitions(trace))


def test_smoothing_equals_scipys_and_can_be_left_out():
    trace, _ = _staircase([0.4, 0.6], noise=0.05)
    x = np.asarray(trace, np.float64)
    median = scipy.ndimage.median_filter(x, 7, mode="nearest")
    np.testing.assert_allclose(running_median(trace, 7), median, atol=1e-6)
    np.testing.assert_array_equal(running_median(trace, 1), trace)
    with pytest.raises(ConfigError, match="smoothing is 0; it must be at least 1"):
        running_median(trace, 0)


def test_a_trace_that_goes_on_standing_has_the_same_boundaries_and_no_more():
    rng = np.random.default_rng(0)
    moves = rng.normal(0.01, 0.05, (40, 50)) * (rng.random((40, 50)) < 0.3)
    traces = jnp.asarray(np.cumsum(moves, axis=1), jnp.float32)
    held = jnp.concatenate([traces, jnp.repeat(traces[:, -1:], 30, axis=1)], axis=1)
    find = jax.vmap(transitions)
    np.testing.assert_array_equal(find(held)[:, :50], find(traces))
    assert not find(held)[:, 50:].any()
