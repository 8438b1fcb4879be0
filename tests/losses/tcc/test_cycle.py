"""Cycle-consistency against a plain loop, with padding, and at aligned and shuffled videos."""

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import losses
from gril_jax.losses import mean_consistency

# Compiled once: without it each test would compile every operation by itself.
cycle_consistency = jax.jit(losses.cycle_consistency)


@jax.jit
def mean_agreement(latents, times, valid, temperature=1.0):
    return mean_consistency(latents, times, valid, temperature=temperature)[1]


def _softmax(x):
    e = np.exp(x - x.max())
    return e / e.sum()


def _oracle(query, other, times, temperature):
    """One query frame at a time, in float64, with plain squared distances."""
    query, other, times = (np.asarray(x, np.float64) for x in (query, other, times))
    scale = query.shape[1] * temperature
    values = []
    for frame, time in zip(query, times, strict=True):
        there = _softmax(np.array([-((frame - o) ** 2).sum() / scale for o in other]))
        neighbour = sum(w * o for w, o in zip(there, other, strict=True))
        back = _softmax(np.array([-((neighbour - q) ** 2).sum() / scale for q in query]))
        values.append((sum(w * t for w, t in zip(back, times, strict=True)) - time) ** 2)
    return np.array(values)


def _video(seed, num_frames, width=6):
    rng = np.random.default_rng(seed)
    return jnp.asarray(rng.normal(size=(num_frames, width)), jnp.float32)


TIMES = jnp.linspace(0.0, 0.9, 7)


def test_well_separated_equal_videos_return_to_the_frame_they_came_from():
    video = 10 * jnp.eye(7)
    assert cycle_consistency(video, video, TIMES).max() < 1e-6


def test_a_constant_video_answers_with_no_time_at_all():
    values = cycle_consistency(_video(0, 7), jnp.zeros((5, 6)), TIMES, temperature=1e6)
    np.testing.assert_allclose(values, (TIMES.mean() - TIMES) ** 2, rtol=1e-3, atol=1e-5)


def test_values_do_not_change_when_both_videos_move_together():
    query, other = _video(0, 7), _video(1, 5)
    shift = jnp.array([3.0, -2.0, 1.0, 0.0, 4.0, -4.0])
    np.testing.assert_allclose(
        cycle_consistency(query + shift, other + shift, TIMES),
        cycle_consistency(query, other, TIMES),
        rtol=1e-2,
        atol=1e-5,
    )


def _agreement(query, other, times, other_times, temperature):
    """Squared difference between each frame's time and its soft neighbour's."""
    scale = query.shape[1] * temperature
    found = []
    for frame, time in zip(np.asarray(query), times, strict=True):
        apart = np.array([-((frame - o) ** 2).sum() / scale for o in np.asarray(other)])
        found.append((_softmax(apart) @ np.asarray(other_times) - time) ** 2)
    return found


def test_a_scrambled_order_that_both_videos_share_closes_cycles_but_disagrees_on_time():
    video, scramble = 10 * jnp.eye(7), jnp.array([3, 5, 0, 6, 2, 4, 1])
    assert cycle_consistency(video, video[scramble], TIMES).max() < 1e-6
    times, valid = jnp.stack([TIMES, TIMES]), jnp.ones((2, 7), bool)
    assert mean_agreement(jnp.stack([video, video[scramble]]), times, valid) > 0.05
    assert mean_agreement(jnp.stack([video, video]), times, valid) < 1e-6


def test_means_over_pairs_equal_a_double_loop_over_videos_of_unequal_length():
    lengths = [7, 4, 2]
    latents = jnp.stack([_video(seed, 7) for seed in range(3)])
    times = jnp.stack([jnp.arange(7) / n for n in lengths])
    valid = jnp.arange(7) < jnp.array(lengths)[:, None]
    pairs = [(i, j) for i in range(3) for j in range(3) if i != j]
    cycles, agreements = [], []
    for i, j in pairs:
        query, other = latents[i, : lengths[i]], latents[j, : lengths[j]]
        time, other_time = times[i, : lengths[i]], times[j, : lengths[j]]
        cycles.extend(_oracle(query, other, time, 0.3))
        agreements.extend(_agreement(query, other, time, other_time, 0.3))
    cycle, agreement = jax.jit(mean_consistency)(latents, times, valid, temperature=0.3)
    np.testing.assert_allclose(cycle, np.mean(cycles), rtol=1e-4)
    np.testing.assert_allclose(agreement, np.mean(agreements), rtol=1e-4)


def test_single_video_and_empty_padding_give_zero_with_finite_gradient():
    latents, times = _video(0, 7)[None], TIMES[None]
    assert mean_consistency(latents, times) == (0, 0)

    @jax.jit
    @jax.value_and_grad
    def summed(latents, times, valid):
        return sum(mean_consistency(latents, times, valid))

    pair, times = jnp.concatenate([latents, latents]), jnp.tile(TIMES, (2, 1))
    value, gradient = summed(pair, times, jnp.zeros((2, 7), bool))
    assert value == 0
    assert np.isfinite(gradient).all()
