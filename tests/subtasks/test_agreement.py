"""Boundaries on which made-up staircases agree."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.subtasks.agreement import agreed_boundaries, agreed_stages, each_alone

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
