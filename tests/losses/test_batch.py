"""The loss of a batch against double loops over videos, and random cycles against theirs."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import tcc_loops
from support.tcc_loops import video

from gril_jax import losses
from gril_jax.errors import ConfigError
from gril_jax.losses.cycle import FORMS

LENGTHS = [7, 4, 5]
LATENTS = jnp.stack([jnp.asarray(video(seed, 7)) for seed in range(3)])
TIMES = jnp.stack([jnp.arange(7) / n for n in LENGTHS])
VALID = jnp.arange(7) < jnp.array(LENGTHS)[:, None]

mean_cycle = jax.jit(losses.mean_cycle_consistency, static_argnames="form")
mean_cycle_slope = jax.jit(jax.value_and_grad(losses.mean_cycle_consistency))
stochastic = jax.jit(losses.stochastic_consistency, static_argnames="num_cycles")
draw = jax.jit(losses.draw_cycles, static_argnames=("num_cycles", "cycle_length"))


def _videos(latents):
    return [np.asarray(x[:n], np.float64) for x, n in zip(latents, LENGTHS, strict=True)]


@pytest.mark.parametrize("form", FORMS)
def test_the_batch_loss_equals_a_double_loop_over_videos_of_unequal_length(form):
    videos, times = _videos(LATENTS), [np.arange(n) / n for n in LENGTHS]
    values = [
        tcc_loops.pair(videos[i], videos[j], times[i], form, temperature=0.5)
        for i in range(3)
        for j in range(3)
        if i != j
    ]
    loss = mean_cycle(LATENTS, TIMES, VALID, form=form, temperature=0.5)
    np.testing.assert_allclose(loss, np.concatenate(values).mean(), rtol=1e-5, atol=1e-6)


def test_the_order_of_the_videos_does_not_matter():
    order = jnp.array([2, 0, 1])
    shuffled = mean_cycle(LATENTS[order], TIMES[order], VALID[order])
    np.testing.assert_allclose(shuffled, mean_cycle(LATENTS, TIMES, VALID), rtol=1e-5)


def test_a_video_without_valid_frames_and_a_single_video_count_for_nothing():
    expected = mean_cycle(LATENTS[:2], TIMES[:2], VALID[:2])
    with_empty = mean_cycle(LATENTS, TIMES, VALID.at[2].set(False))
    np.testing.assert_allclose(with_empty, expected, rtol=1e-5)
    assert mean_cycle(LATENTS[:1], TIMES[:1]) == 0
    value, gradient = mean_cycle_slope(LATENTS, TIMES, jnp.zeros((3, 7), bool))
    assert value == 0
    assert not np.any(gradient)


# --- stochastic matching


@pytest.mark.parametrize("form", FORMS)
def test_given_cycles_of_three_videos_equal_the_loop(form):
    paths, frames = jnp.array([[0, 1, 2], [2, 0, 1], [1, 2, 0]]), jnp.array([6, 0, 3])
    found = jax.jit(functools.partial(losses.sampled_cycle_consistency, form=form))(
        LATENTS, TIMES, paths, frames, VALID
    )
    videos = _videos(LATENTS)
    for value, (u, v, w), frame in zip(found, np.asarray(paths), np.asarray(frames), strict=True):
        logits = tcc_loops.path(videos[u][frame], [videos[v], videos[w], videos[u]])
        times = np.arange(LENGTHS[u]) / LENGTHS[u]
        np.testing.assert_allclose(
            value, tcc_loops.error(logits, times, frame, form), rtol=1e-4, atol=1e-6
        )


def test_all_frames_of_all_pairs_drawn_once_are_the_deterministic_loss():
    pairs = [(i, j, t) for i in range(3) for j in range(3) for t in range(LENGTHS[i]) if i != j]
    paths, frames = jnp.array([p[:2] for p in pairs]), jnp.array([p[2] for p in pairs])

    def sampled(latents):
        return losses.sampled_cycle_consistency(latents, TIMES, paths, frames, VALID).mean()

    value, gradient = jax.jit(jax.value_and_grad(sampled))(LATENTS)
    expected, expected_gradient = mean_cycle_slope(LATENTS, TIMES, VALID)
    np.testing.assert_allclose(value, expected, rtol=1e-5)
    np.testing.assert_allclose(gradient, expected_gradient, rtol=1e-3, atol=1e-6)


def test_cycles_are_drawn_evenly_from_distinct_videos_and_valid_frames():
    videos, frames = draw(jax.random.key(0), VALID, num_cycles=6000, cycle_length=2)
    videos, frames = np.asarray(videos), np.asarray(frames)
    assert (videos[:, 0] != videos[:, 1]).all()
    assert (frames < np.array(LENGTHS)[videos[:, 0]]).all()
    pairs = np.bincount(3 * videos[:, 0] + videos[:, 1], minlength=9).reshape(3, 3)
    np.testing.assert_allclose(pairs, 1000 * (1 - np.eye(3)), atol=150)
    starts = np.bincount(frames[videos[:, 0] == 1], minlength=7)
    np.testing.assert_allclose(starts, [500] * 4 + [0] * 3, atol=100)


def test_the_mean_over_many_random_cycles_approaches_the_deterministic_loss():
    latents, times = LATENTS[:, :4], TIMES[:, :4]
    loss = stochastic(jax.random.key(1), latents, times, num_cycles=4000)
    np.testing.assert_allclose(loss, mean_cycle(latents, times), rtol=0.05)


def test_random_cycles_keep_clear_of_empty_videos_and_stay_finite():
    valid = VALID.at[2].set(False)
    videos, _ = draw(jax.random.key(0), valid, num_cycles=50, cycle_length=2)
    assert videos.max() == 1
    slope = jax.jit(jax.value_and_grad(losses.stochastic_consistency, argnums=1))
    for mask in (valid, jnp.zeros_like(valid)):
        value, gradient = slope(jax.random.key(0), 1e30 * LATENTS, TIMES, mask)
        assert np.isfinite(value)
        assert np.isfinite(gradient).all()
    assert value == 0


def test_a_cycle_longer_than_the_batch_is_refused():
    with pytest.raises(ConfigError, match="from 1 to the number of videos, 3"):
        losses.draw_cycles(jax.random.key(0), VALID, num_cycles=4, cycle_length=4)
    with pytest.raises(ConfigError, match="num_cycles is 0"):
        losses.draw_cycles(jax.random.key(0), VALID, num_cycles=0)
