"""XIRL's training and reward on tiny made-up videos, with the first blocks of its network."""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax import reward
from gril_jax.encoders import resnet
from gril_jax.encoders.encoder import PixelConfig
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.pretraining import pixel_pretrain
from gril_jax.pretraining.options import Hyper
from gril_jax.pretraining.pixel_pretrain import PixelStatic
from gril_jax.reward import pixels as pixel_reward
from gril_jax.rl import rewards
from gril_jax.types import VideoBatch

SIDE, FRAMES = 16, 12
ENCODER = PixelConfig(3, pixels=SIDE)  # of this size here alone: its programs are not ResNet-18's
CONFIG = PixelStatic(ENCODER, updates=40, num_videos=3, num_frames=8)
HYPER = Hyper(learning_rate=1e-3, temperature=0.1, warmup=0.0)


def _videos(num, seed=0):
    """A red square that moves to the right over dark noise, the last video cut short."""
    rng = np.random.default_rng(seed)
    frames = rng.integers(0, 60, (num, FRAMES, SIDE, SIDE, 3)).astype(np.uint8)
    for t in range(FRAMES):
        frames[:, t, 5:10, t : t + 5] = (250, 30, 30)
    length = np.full(num, FRAMES, np.int32)
    length[-1] = 9
    frames[-1, 9:] = frames[-1, 8]
    return VideoBatch(jnp.asarray(frames), jnp.asarray(length))


class _Moment(NamedTuple):
    """As much of a task's state as a reward of pictures looks at."""

    data: jax.Array


@pytest.fixture(scope="module", autouse=True)
def _small_network():
    """Two stages of eight channels: the whole network takes a minute to compile."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resnet, "STAGES", ((64, 1), (8, 2)))
        yield


@pytest.fixture(scope="module")
def found():
    """Metrics, the state, its reward and the figures on the videos, out of a single program."""

    # Convolutions take a minute as tests/conftest.py has them compiled, and seconds like this.
    @functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 1})
    def everything(key, videos):
        state = pixel_pretrain.init(key, videos, CONFIG)
        trained, metrics = pixel_pretrain.step(state, videos, HYPER, CONFIG)
        learned = pixel_reward.from_videos(trained.params, videos, ENCODER)
        latents = pixel_reward.embed(trained.params, videos, ENCODER)
        figures = pixel_pretrain.evaluate(trained.params, videos, videos, CONFIG)
        rule = rewards.pixels(ENCODER, lambda data: data)
        one = lambda frame: rule(learned, _Moment(frame), jnp.zeros(1, bool))  # noqa: E731
        many = jax.vmap(jax.vmap(one))(videos.frames)
        alone = one(videos.frames[1, 3])
        return state, trained, metrics, learned, latents, figures, many, alone

    videos = _videos(4)
    return videos, *everything(jax.random.key(0), videos)


def test_cycle_consistency_alone_falls(found):
    metrics = found[3]
    np.testing.assert_array_equal(metrics.loss, metrics.consistency)  # no warm-up, nothing else
    assert np.isfinite(metrics.gradient_norm).all()
    assert metrics.loss[-8:].mean() < 0.7 * metrics.loss[:8].mean()


def test_weights_are_learned_and_statistics_move_on(found):
    _, fresh, trained, *_ = found
    for part in ("weights", "statistics"):
        old, new = (jax.tree.leaves(s.params[part]) for s in (fresh, trained))
        assert all(bool((a != b).any()) for a, b in zip(old, new, strict=True))
    assert int(trained.num_updates) == CONFIG.updates


def test_the_reward_is_minus_one_at_first_frames_and_near_zero_at_last_ones(found):
    videos, _, _, _, learned, latents, figures, many, _ = found
    last = np.asarray(latents)[np.arange(4), np.asarray(videos.length) - 1]
    np.testing.assert_allclose(learned.goal, last.mean(0), rtol=1e-3, atol=1e-4)
    apart = np.linalg.norm(np.asarray(latents)[:, 0] - last.mean(0), axis=-1).mean()
    np.testing.assert_allclose(learned.scale, 1 / apart, rtol=1e-3)
    np.testing.assert_allclose(many[:, 0].mean(), -1.0, atol=1e-3)
    ends = np.asarray(many)[np.arange(4), np.asarray(videos.length) - 1]
    assert ends.mean() > -0.7  # statistics of few updates: the rest is noise
    np.testing.assert_allclose(figures["reward_first"], many[:, 0].mean(), atol=1e-3)
    np.testing.assert_allclose(figures["reward_last"], ends.mean(), atol=1e-3)
    np.testing.assert_allclose(many, reward.latent_reward(learned, latents), rtol=1e-3, atol=1e-3)


def test_a_picture_alone_is_paid_as_among_others(found):
    many, alone = found[-2:]
    np.testing.assert_allclose(alone, many[1, 3], rtol=1e-3, atol=1e-4)


def test_what_cannot_be_trained_is_refused():
    with pytest.raises(ConfigError, match=r"pretrain\.num_videos is 3 but there are 2"):
        pixel_pretrain.init(jax.random.key(0), _videos(2), CONFIG)
    with pytest.raises(ConfigError, match=r"pretrain\.num_frames is 1; it must be at least 2"):
        dataclasses.replace(CONFIG, num_frames=1)
    with pytest.raises(ShapeError, match=r"with encoder\.pixels 16 height and width must be 16"):
        resnet._flat(jnp.zeros((2, 8, 8, 3)), ENCODER)
    with pytest.raises(ConfigError, match=r"encoder\.pixels is 0"):
        PixelConfig(3, pixels=0)


@pytest.mark.slow
def test_seeds_side_by_side_learn_as_one_by_one():
    videos, config = _videos(4), dataclasses.replace(CONFIG, updates=2)
    keys = jax.random.split(jax.random.key(0), 2)

    def train(key):
        state = pixel_pretrain.init(key, videos, config)
        return pixel_pretrain.step(state, videos, HYPER, config)[1].loss

    together = jax.jit(jax.vmap(train))(keys)
    alone = jax.jit(lambda keys: jax.lax.map(train, keys))(keys)
    np.testing.assert_allclose(together, alone, rtol=1e-2, atol=1e-4)


@pytest.mark.slow
def test_turned_videos_and_other_forms_train():
    videos = _videos(4)
    for name in ("tcc_classification", "tcc_stochastic"):
        config = dataclasses.replace(CONFIG, updates=2, turn_scenes=True, consistency=name)
        state = jax.jit(pixel_pretrain.init)(jax.random.key(0), videos, config)
        _, metrics = pixel_pretrain.step(state, videos, Hyper(), config)
        assert np.isfinite(metrics.loss).all()
        assert (metrics.loss != metrics.consistency).all()  # the warm-up
