"""Losses of heads that predict progress, each against a loop that is written from its equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.config.tables import ALIGNMENTS
from gril_jax.errors import ConfigError
from gril_jax.losses import heads, progressor, timerewarder
from gril_jax.losses.heads import Clip

METHODS = [name for name, one in ALIGNMENTS.items() if one.head]
LATENT, KEY = 3, jax.random.key(1)
losses = jax.jit(lambda head, clip: head.loss(KEY, clip))


def _head(method):
    """Parameters of usual size, all different from 0; SARM has three stages."""
    head = heads.of(method).init(jax.random.key(0), LATENT)
    rng = np.random.default_rng(0)
    head = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape), jnp.float32), head)
    if method == "sarm":
        head = head._replace(proportions=jnp.zeros(12).at[:3].set(jnp.array([0.5, 0.2, 0.3])))
    return head


def _clip(frames=(0, 2, 3, 7, 9, 6, 3), length=10, padding=2):
    """A video that is played backwards at the end, and then padding."""
    rng = np.random.default_rng(1)
    count = len(frames) + padding
    frames = np.array([*frames, *range(40, 40 + padding)])
    valid = np.arange(count) < count - padding
    stages = np.where(valid, 3 * frames / max(length - 1, 1), 0).astype(np.float32)
    latents = rng.normal(size=(count, LATENT)).astype(np.float32)
    return jax.tree.map(jnp.asarray, Clip(latents, frames, jnp.int32(length), valid, stages))


def _sigmoid(x):
    return 1 / (1 + np.exp(-x))


def _softmax(x):
    return np.exp(x) / np.exp(x).sum()


# --- the equations, frame by frame


def _timerewarder(head, clip):
    total = weights = 0.0
    for u in np.flatnonzero(clip.valid):
        for v in np.flatnonzero(clip.valid):
            d = int(clip.frames[v] - clip.frames[u])
            if not d:
                continue
            place = (d / (clip.length - 1) + 1) / 2 * 19
            low = min(int(np.floor(place)), 18)
            both = np.concatenate([clip.latents[u], clip.latents[v]])
            chance = np.log(_softmax(both @ head.kernel + head.bias))
            error = -(low + 1 - place) * chance[low] - (place - low) * chance[low + 1]
            # P(interval) ~ 1 / interval, and each pair of an interval is as likely as the others.
            weight = 1 / abs(d) / (clip.length - abs(d))
            total, weights = total + weight * error, weights + weight
    return total / weights if weights else 0.0


def _rewind(head, clip):
    errors = [
        (_sigmoid(clip.latents[i] @ head.kernel[:, 0] + head.bias) - (t + 1) / clip.length) ** 2
        for i, t in enumerate(clip.frames)
        if clip.valid[i]
    ]
    return np.mean(errors)


def _sarm(head, clip):
    errors = []
    for i in np.flatnonzero(clip.valid):
        k = min(int(clip.stages[i]), 2)
        logits = clip.latents[i] @ head.stage + head.stage_bias
        share = _sigmoid(clip.latents[i] @ head.share[:, k] + head.share_bias[k])
        errors.append((share - (clip.stages[i] - k)) ** 2 - np.log(_softmax(logits[:3])[k]))
    return np.mean(errors)


def _progressor(head, clip):
    chosen, counted = map(np.asarray, progressor.triplets(KEY, jax.tree.map(jnp.asarray, clip)))
    values = []
    for i, j, g in chosen[counted]:
        both = np.concatenate([clip.latents[i], clip.latents[j], clip.latents[g]])
        hidden = np.maximum(both @ head.hidden + head.hidden_bias, 0)
        mean, log_deviation = hidden @ head.out + head.out_bias
        span = float(clip.frames[g] - clip.frames[i])
        target, deviation = (clip.frames[j] - clip.frames[i]) / span, max(1 / span, 1e-3)
        # KL of two normal distributions, by its closed form.
        ratio = (deviation**2 + (target - mean) ** 2) / (2 * np.exp(log_deviation) ** 2)
        values.append(log_deviation - np.log(deviation) + ratio - 0.5)
    return np.mean(values) if values else 0.0


LOOPS = {
    "timerewarder": _timerewarder, "rewind": _rewind, "sarm": _sarm, "progressor": _progressor,
}  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
def test_each_loss_is_the_loop_over_its_equations(method):
    head, clip = _head(method), _clip()
    as_numpy = jax.tree.map(lambda x: np.asarray(x, np.float64), (head, clip))
    found, plain = losses(head, clip), head.loss(KEY, clip)
    expected = LOOPS[method](*_indexed(as_numpy, clip))
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    np.testing.assert_allclose(plain, expected, rtol=1e-5)


def _indexed(as_numpy, clip):
    head, other = as_numpy
    return head, other._replace(frames=np.asarray(clip.frames), valid=np.asarray(clip.valid))


@pytest.mark.parametrize("method", METHODS)
def test_padding_does_not_count_and_short_videos_are_finite(method):
    head, clip = _head(method), _clip()
    other = clip._replace(latents=clip.latents.at[-2:].set(1e3), frames=clip.frames.at[-1].set(0))
    np.testing.assert_allclose(losses(head, clip), losses(head, other), rtol=1e-6)
    for frames in ((0,), (0, 1)):
        short = _clip(frames, length=len(frames), padding=7)
        value, gradient = jax.jit(jax.value_and_grad(lambda h, c: h.loss(KEY, c)))(head, short)
        assert all(np.isfinite(x).all() for x in jax.tree.leaves((value, gradient)))
        indexed = _indexed(jax.tree.map(lambda x: np.asarray(x, np.float64), (head, short)), short)
        np.testing.assert_allclose(value, LOOPS[method](*indexed), rtol=1e-5, atol=1e-7)


# --- what is predicted


def test_a_target_is_split_between_the_two_nearest_bins():
    x = jnp.linspace(-1.0, 1.0, 41)
    weights = timerewarder.two_hot(x)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-5)
    np.testing.assert_allclose(weights @ jnp.linspace(-1.0, 1.0, 20), x, atol=1e-6)
    assert ((weights > 1e-5).sum(axis=1) <= 2).all()


def test_timerewarder_predicts_the_mean_of_its_bins_for_a_step_and_since_the_start():
    head = _head("timerewarder")
    first, second = jax.random.normal(KEY, (2, LATENT))
    both = np.concatenate([first, second])
    expected = _softmax(both @ np.asarray(head.kernel) + np.asarray(head.bias))
    expected = expected @ np.linspace(-1, 1, 20)
    np.testing.assert_allclose(head.distance(first, second), expected, rtol=1e-5)
    np.testing.assert_allclose(head.progress(second, first, first), expected, rtol=1e-5)


def test_sarm_adds_the_share_of_the_likeliest_stage_to_the_stages_before():
    head = _head("sarm")._replace(stage=jnp.zeros((LATENT, 12)), share=jnp.zeros((LATENT, 12)))
    for stage, before in enumerate((0.0, 0.5, 0.7)):
        bias = jnp.zeros(12).at[stage].set(5.0).at[7].set(9.0)  # the eighth is no stage
        found = head._replace(stage_bias=bias, share_bias=jnp.zeros(12))
        expected = before + 0.5 * float(head.proportions[stage])
        np.testing.assert_allclose(found.progress(*jnp.zeros((3, LATENT))), expected, rtol=1e-5)


def test_progressor_subtracts_four_tenths_of_the_entropy():
    head = _head("progressor")
    start, latent, goal = jax.random.normal(KEY, (3, LATENT))
    mean, log_deviation = head.predicted(start, latent, goal)
    entropy = 0.5 * np.log(2 * np.pi * np.e * np.exp(2 * log_deviation))
    np.testing.assert_allclose(head.progress(latent, start, goal), mean - 0.4 * entropy, rtol=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_a_head_has_a_name_and_predicts_for_any_batch(method):
    head = _head(method)
    assert heads.name_of(head) == method
    start, goal = jnp.zeros((2, LATENT))
    assert head.progress(jnp.ones((2, 5, LATENT)), start, goal).shape == (2, 5)


def test_a_method_without_a_head_is_refused():
    with pytest.raises(ConfigError, match="head is 'tcc'; it must be 'timerewarder'"):
        heads.of("tcc")
