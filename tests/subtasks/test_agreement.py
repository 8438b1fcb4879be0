"""Boundaries on which made-up staircases agree."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.ndimage
import scipy.signal

from gril_jax import subtasks
from gril_jax.errors import ConfigError
from gril_jax.subtasks.agreement import agreed_boundaries, agreed_stages, each_alone, running_median

agreed = jax.jit(agreed_boundaries, static_argnames="smoothing")
stages = jax.jit(agreed_stages, static_argnames="smoothing")
alone = jax.jit(each_alone, static_argnames="smoothing")
FRAMES = 300
HEIGHTS = (0.3, 0.3, 0.4)
TWENTY = jnp.int32(20)


def _stairs(seed, *, noise=0.0, pause=None):
    """From -1 to 0 in three steps with a pause half way up some; the frames where steps end."""
    rng = np.random.default_rng(seed)
    level, trace, ends = -1.0, [], []
    for height in HEIGHTS:
        trace += [level] * int(rng.integers(35, 50))
        half = np.linspace(0, height / 2, 10)
        wait = int(rng.choice([0, 12])) if pause is None else pause
        trace += [*(level + half), *[level + height / 2] * wait, *(level + height / 2 + half)]
        level += height
        ends.append(len(trace) - 1)
    trace = np.array([*trace, *[level] * 10])
    return trace + rng.normal(0, noise, len(trace)), ends


def _batch(num=8, **options):
    made = [_stairs(seed, **options) for seed in range(num)]
    length = np.array([len(trace) for trace, _ in made], np.int32)
    padded = np.full((num, FRAMES), np.nan, np.float32)
    for row, (trace, _) in zip(padded, made, strict=True):
        row[: len(trace)] = trace
    return jnp.asarray(padded), jnp.asarray(length), np.array([ends for _, ends in made])


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_three_stairs_are_found_with_the_patience_on_which_traces_agree(noise):
    reward, length, ends = _batch(noise=noise)
    patience, found = stages(reward, length)
    assert 10 < int(patience) < 35  # longer than a pause, shorter than a plateau
    jax.tree.map(np.testing.assert_array_equal, found, agreed(reward, length, patience=patience))
    assert found.kept.tolist() == [True] * 3 + [False] * 9
    assert np.abs(found.frames[:, :3] - ends).max() <= 8
    np.testing.assert_allclose(found.level[:3], [-0.7, -0.4, 0.0], atol=0.05)
    assert (np.asarray(found.frames)[:, 3:] == -1).all()


@pytest.mark.parametrize("frames", [60, 120, 300])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_a_smooth_rise_is_one_stage(frames, noise):
    """Traces are steep at different places; a wave of noise is no plateau on which they agree."""
    t, rng = np.linspace(0, 1, frames), np.random.default_rng(0)
    steep = rng.uniform(0.8, 1.25, (12, 1))
    rises = t + 0 * steep, 1 / (1 + np.exp(-8 * steep * (t - 0.5))), t ** (2 * steep)
    for rise in rises:
        reward = jnp.asarray(rise - 1 + rng.normal(0, noise, rise.shape), jnp.float32)
        _, found = stages(reward, jnp.full(12, frames, jnp.int32))
        assert int(found.kept.sum()) == 1
        assert (np.asarray(found.frames[:, 0]) > 0.5 * frames).all()


def test_too_short_a_patience_finds_the_pauses_too():
    reward, length, _ = _batch(pause=12)
    counts = np.sum(
        np.asarray(alone(reward, length, smoothing=15, patience=jnp.int32(5))) >= 0, axis=1
    )
    assert (counts == 6).all()


def test_what_few_show_is_dropped_and_what_one_lacks_is_placed_where_its_level_is_reached():
    reward, length, ends = _batch()
    reward = np.array(reward)
    first, second = ends[0][:2]
    reward[0, first : second + 1] = np.linspace(-0.7, -0.4, second + 1 - first)  # no plateau
    reward[1, : ends[1][0] - 25] = np.linspace(-1.4, -1.4, ends[1][0] - 25)  # one rise more
    own = np.asarray(alone(jnp.asarray(reward), length, smoothing=15, patience=TWENTY))
    assert (own[0] >= 0).sum() == 2
    found = agreed(jnp.asarray(reward), length, patience=TWENTY)
    assert int(found.kept.sum()) == 3
    assert not bool(found.found[0, 0])
    assert abs(int(found.frames[0, 0]) - first) <= 8
    assert np.abs(found.frames[1, :3] - ends[1]).max() <= 8


def test_a_trace_with_as_many_ends_as_the_others_keeps_its_own_at_rewards_not_far_off():
    reward, length, ends = _batch()
    reward = np.array(reward)
    reward[0, ends[0][0] - 25 : ends[0][1] - 15] = -0.85  # its first plateau lies lower
    found = agreed(jnp.asarray(reward), length, patience=TWENTY)
    own = np.asarray(alone(jnp.asarray(reward), length, smoothing=15, patience=TWENTY))
    assert (own >= 0).sum(axis=1).tolist() == [3] * 8
    np.testing.assert_array_equal(found.frames[:, :3], own[:, :3])
    assert bool(found.found[:, :3].all())
    assert found.support[:3].tolist() == [1, 1, 1]
    assert int(found.frames[0, 0]) < ends[0][0]


def test_as_many_ends_of_which_one_is_another_are_not_kept():
    reward, length, ends = _batch()
    reward = np.array(reward)
    first, second = ends[0][:2]
    reward[0, first : second + 1] = np.linspace(-0.7, -0.4, second + 1 - first)  # no plateau
    reward[0, :8] = -3.0  # and a step before anything has been done
    own = np.asarray(alone(jnp.asarray(reward), length, smoothing=15, patience=TWENTY))
    assert (own[0] >= 0).sum() == 3
    assert own[0, 0] < 10
    found = agreed(jnp.asarray(reward), length, patience=TWENTY)
    assert abs(int(found.frames[0, 0]) - first) <= 8
    assert not bool(found.found[0, 0])


def test_ends_increase_where_one_falls_short_of_a_level_and_then_jumps():
    reward, length, ends = _batch()
    reward = np.array(reward)
    reward[0, ends[0][0] - 20 : ends[0][1]] = -0.84
    found = agreed(jnp.asarray(reward), length, patience=TWENTY)
    assert (np.diff(found.frames[:, :3], axis=1) > 0).all()


def test_padding_and_the_order_of_demonstrations_play_no_part():
    reward, length, _ = _batch()
    base = agreed(reward, length, patience=TWENTY)
    other = jnp.where(jnp.isnan(reward), 7.0, reward)[::-1]
    turned = agreed(other, length[::-1], patience=TWENTY)
    np.testing.assert_array_equal(turned.frames[::-1], base.frames)
    np.testing.assert_allclose(turned.level, base.level, atol=1e-6)


def test_rewards_that_never_rise_have_no_stage():
    flat = jnp.zeros((8, FRAMES))
    length = jnp.full(8, FRAMES)
    assert not agreed(flat, length, patience=TWENTY).kept.any()
    patience, found = stages(flat, length)
    assert int(patience) >= 1
    assert not found.kept.any()


def test_stages_agree_where_some_have_further_to_go_than_others():
    """As with objects that begin further away or less far: plateaus at half of the way."""
    frames, traces = np.arange(200), []
    for start, first, second in (
        (-0.8, 60, 150),
        (-1.4, 40, 130),
        (-1.1, 80, 170),
        (-0.9, 70, 140),
    ):
        knots = [0, first - 20, first, second - 20, second, 199]
        traces.append(np.interp(frames, knots, [start, start, start / 2, start / 2, 0, 0]))
    reward, length = jnp.asarray(np.stack(traces), jnp.float32), jnp.full(4, 200)
    found = agreed(reward, length, patience=TWENTY)
    assert int(found.kept.sum()) == 2
    assert bool(found.found[:, :2].all())
    wanted = [[60, 150], [40, 130], [80, 170], [70, 140]]
    assert np.abs(np.asarray(found.frames[:, :2]) - wanted).max() <= 8
    np.testing.assert_allclose(found.level[:2], [-0.525, 0.0], atol=0.05)


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
    for width in (0, 4):
        with pytest.raises(ConfigError, match=f"smoothing is {width}; it must be an odd number"):
            running_median(trace, width)


@pytest.mark.parametrize("support", [0.0, 3.0])
def test_a_support_that_is_no_share_is_refused(support):
    with pytest.raises(ConfigError, match=f"support is {support}; it must be above 0"):
        agreed_boundaries(jnp.zeros((2, 30)), jnp.full(2, 30), support=support)


def test_a_trace_that_goes_on_standing_has_the_same_boundaries_and_no_more():
    rng = np.random.default_rng(0)
    moves = rng.normal(0.01, 0.05, (40, 50)) * (rng.random((40, 50)) < 0.3)
    traces = jnp.asarray(np.cumsum(moves, axis=1), jnp.float32)
    held = jnp.concatenate([traces, jnp.repeat(traces[:, -1:], 30, axis=1)], axis=1)
    find = jax.vmap(transitions)
    np.testing.assert_array_equal(find(held)[:, :50], find(traces))
    assert not find(held)[:, 50:].any()
