"""Trains the pixel encoder on videos, as XIRL does: temporal cycle-consistency alone.

    config = PixelStatic(encoder=PixelConfig(pixels=64))
    state = init(key, videos, config)
    for _ in range(20):
        state, metrics = step(state, videos, Hyper(), config)
    evaluate(state.params, held_out, videos, config)

Zakka et al., XIRL (CoRL 2021), start from weights of ImageNet; here they are random. Of `Hyper` it
takes `learning_rate`, `final_learning_rate_fraction`, `decay_updates`, `temperature` and `warmup`
(0 is XIRL's). Every function is pure and can be jitted, and vmapped over seeds and over `Hyper`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.encoders import resnet
from gril_jax.encoders.message_passing import Params
from gril_jax.errors import ConfigError
from gril_jax.reward import pixels as pixel_reward
from gril_jax.types import VideoBatch

from . import batch
from .loss import aligned
from .options import Hyper, PixelStatic
from .pretrain import ADAM, Part, TrainState, agreement_weight, figures, repeated, updated


class Metrics(NamedTuple):
    """One value for each update of a `step`."""

    loss: Float[Array, "updates"]  # cycle-consistency, plus the fading time agreement
    consistency: Float[Array, "updates"]
    gradient_norm: Float[Array, "updates"]


@jax.jit
def init(key: PRNGKeyArray, videos: VideoBatch, config: PixelStatic) -> TrainState:
    """Fresh parameters and optimiser state. The key is consumed.

    Raises:
      ConfigError: a batch would hold more videos than there are.
    """
    if config.num_videos > videos.length.shape[0]:
        raise ConfigError(
            f"pretrain.num_videos is {config.num_videos} but there are {videos.length.shape[0]} "
            f"demonstrations; it must be at most their number."
        )
    encoder_key, key = jax.random.split(key)
    params = resnet.init(encoder_key, config.encoder)
    return TrainState(params, ADAM.init(params), key, jnp.zeros((), jnp.int32))


@jax.jit
def step(
    state: TrainState,
    videos: VideoBatch,
    hyper: Hyper,
    config: PixelStatic,
    part: Part | None = None,
) -> tuple[TrainState, Metrics]:
    """`config.updates` gradient updates in one compiled call, or a part of them."""

    def update(state, _):
        key, batch_key, turn_key = jax.random.split(state.key, 3)
        frames, valid, chosen = batch.draw(batch_key, videos.length, videos.frames.shape[1], config)
        pictures = videos.frames[chosen[:, None], frames]
        if config.turn_scenes:
            pictures = resnet.turn(turn_key, pictures)
        times = frames / videos.length[chosen, None]
        fading = agreement_weight(state, hyper)

        def loss(params):
            latents, moved = resnet.apply_train(params, resnet.floats(pictures), config.encoder)
            cycle_key = jax.random.fold_in(batch_key, 2)  # `draw` splits it into 0 and 1
            cycle, agreement = aligned(cycle_key, latents, times, valid, hyper, config)
            return cycle + fading * agreement, (cycle, moved["statistics"])

        (total, aux), gradient = jax.value_and_grad(loss, has_aux=True)(state.params)
        params, moments = updated(ADAM, state, gradient, hyper)
        params = {**params, "statistics": aux[1]}
        values = Metrics(total, aux[0], optax.tree.norm(gradient))
        return TrainState(params, moments, key, state.num_updates + 1), values

    return repeated(update, state, config.updates, part)


@jax.jit
def evaluate(
    params: Params, videos: VideoBatch, train: VideoBatch, config: PixelStatic
) -> dict[str, Float[Array, ""]]:
    """Measures how well the encoder orders videos, ideally ones it has not been trained on.

    Goal and scale of the reward come from `train`, the training videos. Returns the same figures as
    `gril_jax.pretraining.pretrain.evaluate`.
    """
    latents = pixel_reward.embed(params, videos, config.encoder)
    learned = pixel_reward.from_videos(params, train, config.encoder)
    return figures(learned, latents, videos.length)
