"""Training the encoder on demonstrations: cycle-consistency plus reconstruction (Eq. 6).

    config = PretrainConfig(encoder=EncoderConfig(num_classes=7))
    state = init(key, demos, config)
    for _ in range(20):
        state, metrics = step(state, demos, Hyper(), config)
    evaluate(state.params.encoder, held_out, demos, Hyper(), config)

Every function is pure and can be jitted, and vmapped over seeds (the key or the state) and over
the values in `Hyper`. Shapes use B for demonstrations, V for the videos of a batch, T and F for
frames, N for objects, H for the node embedding and D for the latent.
"""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import activity, encoder, metrics, reward
from .encoder import EncoderConfig, Params
from .errors import ConfigError
from .graphs import safe_norm, scene_graph
from .losses import decode, mean_consistency, reconstruction
from .losses.reconstruction import init as init_decoder
from .types import DemoBatch

__all__ = [
    "Hyper",
    "Metrics",
    "PretrainConfig",
    "State",
    "TrainParams",
    "embed",
    "evaluate",
    "init",
    "step",
]


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class PretrainConfig:
    """Static choices: another value is another compiled program. A pytree without leaves."""

    encoder: EncoderConfig
    """The network."""
    updates: int = 100
    """Gradient updates in one call of `step`."""
    num_videos: int = 8
    """Videos in a batch; all ordered pairs of them are compared."""
    num_frames: int = 32
    """Frames drawn from each video of a batch."""
    window: int = 40
    """Activity window in frames (Eq. 4)."""
    turn_scenes: bool = False
    """Turn and mirror each video of a batch at random, as one of the square's eight symmetries.

    For scenes seen from above whose origin is the middle of a square arena.
    """

    touched: float = 0.0
    """Probability that an object of a video counts as moved throughout, whatever it does.

    Else a bit that no demonstration sets is a state that the encoder has never seen, and a policy
    can earn by setting it: by a mere touch.
    """

    def __post_init__(self):
        least = {"updates": 1, "num_videos": 2, "num_frames": 2, "window": 1}
        for field, minimum in least.items():
            if getattr(self, field) < minimum:
                raise ConfigError(
                    f"pretrain.{field} is {getattr(self, field)}; it must be at least {minimum}."
                )


class Hyper(NamedTuple):
    """Traced values: a sweep over them is a vmap and compiles once."""

    learning_rate: Float[Array, ""] | float = 1e-3
    lambda_: Float[Array, ""] | float = 1.0  # weight of the reconstruction (Eq. 6)
    temperature: Float[Array, ""] | float = 1.0  # of the cycle's soft nearest neighbours
    alpha: Float[Array, ""] | float = 5.0  # weight of an active node in the pooling (Eq. 3)
    tau: Float[Array, ""] | float = 0.005  # activity threshold in box diagonals (Eq. 4)
    warmup: Float[Array, ""] | float = 1500.0  # updates over which the time agreement fades out


class TrainParams(NamedTuple):
    """What is trained. The reward needs only the encoder."""

    encoder: Params
    decoder: Params


class State(NamedTuple):
    """Everything the next update depends on; saving it is enough to resume bit for bit."""

    params: TrainParams
    optimizer: optax.OptState
    key: PRNGKeyArray
    num_updates: Int[Array, ""]


class Metrics(NamedTuple):
    """One value for each update of a `step`."""

    loss: Float[Array, "updates"]  # Eq. 6, plus the fading time agreement
    cycle: Float[Array, "updates"]  # squared error of normalised time
    reconstruction: Float[Array, "updates"]
    gradient_norm: Float[Array, "updates"]


@jax.jit
def init(key: PRNGKeyArray, demos: DemoBatch, config: PretrainConfig) -> State:
    """Fresh parameters and optimiser state. The key is consumed.

    Raises:
      ConfigError: a batch would hold more videos than there are demonstrations.
    """
    num_demos = demos.length.shape[0]
    if config.num_videos > num_demos:
        raise ConfigError(
            f"pretrain.num_videos is {config.num_videos} but there are {num_demos} "
            f"demonstrations; it must be at most their number."
        )
    encoder_key, decoder_key, key = jax.random.split(key, 3)
    params = TrainParams(
        encoder.init(encoder_key, config.encoder), init_decoder(decoder_key, config.encoder)
    )
    return State(params, _optimizer().init(params), key, jnp.zeros((), jnp.int32))


@jax.jit
def step(
    state: State, demos: DemoBatch, hyper: Hyper, config: PretrainConfig
) -> tuple[State, Metrics]:
    """`config.updates` gradient updates in one compiled call, without talking to the host."""
    active = _activity(demos, hyper, config)

    def update(state, _):
        key, batch_key, turn_key, touch_key = jax.random.split(state.key, 4)
        frames, valid, videos = _draw(batch_key, demos.length, demos.center.shape[1], config)
        batch = jax.tree.map(lambda x: x[videos], (demos, active))
        if config.turn_scenes:
            batch = (_turned(turn_key, batch[0]), batch[1])
        if config.touched > 0:
            some = jax.random.bernoulli(touch_key, config.touched, batch[0].label.shape)
            batch = (batch[0], batch[1] | some[:, None, :])

        # Eq. 6 alone, after the first updates: see `gril_jax.losses.time_agreement`.
        fading = jnp.clip(1.0 - state.num_updates / jnp.maximum(hyper.warmup, 1.0), 0.0, 1.0)
        fading = jnp.where(hyper.warmup > 0, fading, 0.0)

        def loss(params):
            cycle, agreement, rebuilt = _losses(params, *batch, frames, valid, hyper, config)
            total = cycle + hyper.lambda_ * rebuilt
            return total + fading * agreement, (cycle, rebuilt)

        (total, parts), gradient = jax.value_and_grad(loss, has_aux=True)(state.params)
        direction, optimizer = _optimizer().update(gradient, state.optimizer, state.params)
        direction = jax.tree.map(lambda d: -hyper.learning_rate * d, direction)
        params = optax.apply_updates(state.params, direction)
        values = Metrics(total, *parts, optax.global_norm(gradient))
        return State(params, optimizer, key, state.num_updates + 1), values

    return jax.lax.scan(update, state, length=config.updates)


@jax.jit
def embed(
    params: Params, demos: DemoBatch, hyper: Hyper, config: PretrainConfig
) -> Float[Array, "B T D"]:
    """The latent of every frame of every demonstration, padding included.

    Args:
      params: of the encoder (`state.params.encoder`).
      demos: any demonstrations; one at a time is in memory.
      hyper: its `alpha` and `tau` are used.
      config: its `encoder` and `window` are used.
    """

    def one(demo_and_active):
        demo, active = demo_and_active
        frames = jnp.arange(demo.center.shape[0])
        return _latents(params, demo, active, frames, hyper, config)[0]

    return jax.lax.map(one, (demos, _activity(demos, hyper, config)))


@jax.jit
def evaluate(
    params: Params, demos: DemoBatch, train: DemoBatch, hyper: Hyper, config: PretrainConfig
) -> dict[str, Float[Array, ""]]:
    """How well the encoder orders demonstrations, best ones it has not been trained on.

    Args:
      params: of the encoder (`state.params.encoder`).
      demos: the demonstrations to order.
      train: the training demonstrations; goal and scale of the reward come from them.
      hyper: its `alpha` and `tau` are used.
      config: its `encoder` and `window` are used.

    Returns:
      `tau`: Kendall's tau of nearest-neighbour alignment, mean over ordered pairs of `demos`.
      `reward_time_tau`: Kendall's tau of the reward against time, mean over `demos`.
      `reward_first`, `reward_last`: mean reward at the first and the last frames.
      High values say that demonstrations are ordered, not that a reward is safe to optimise.
    """
    latents = embed(params, demos, hyper, config)
    learned = reward.from_demos(
        params, train, config.encoder, alpha=hyper.alpha, tau=hyper.tau, window=config.window
    )
    rewards = -learned.scale * safe_norm(latents - learned.goal)
    last = jnp.take_along_axis(rewards, demos.length[:, None] - 1, axis=1)
    return {
        "tau": metrics.mean_alignment_tau(latents, demos.length),
        "reward_time_tau": jnp.mean(jax.vmap(metrics.reward_time_tau)(rewards, demos.length)),
        "reward_first": jnp.mean(rewards[:, 0]),
        "reward_last": jnp.mean(last),
    }


def _optimizer():
    """Adam without its step size, which is traced; norm clipped against rare long steps."""
    return optax.chain(optax.clip_by_global_norm(1.0), optax.scale_by_adam())


def _activity(demos, hyper, config) -> Bool[Array, "B T N"]:
    """Bits from the full recordings: a bit that latched between two drawn frames is set."""

    def one(center, size):
        return activity.trajectory(center, size, tau=hyper.tau, window=config.window)

    return jax.vmap(one)(demos.center, demos.size)


def _draw(
    key: PRNGKeyArray, length: Int[Array, "B"], num_frames: int, config: PretrainConfig
) -> tuple[Int[Array, "V F"], Bool[Array, "V F"], Int[Array, "V"]]:
    """Distinct random videos, and distinct random frames of each in order of time.

    A video shorter than the number of frames gives all it has; the rest is not valid.
    """
    video_key, frame_key = jax.random.split(key)
    videos = jax.random.choice(video_key, len(length), (config.num_videos,), replace=False)
    limit = length[videos, None]
    noise = jax.random.uniform(frame_key, (config.num_videos, num_frames))
    noise = jnp.where(jnp.arange(num_frames) < limit, noise, -1.0)  # padding is drawn last
    _, frames = jax.lax.top_k(noise, min(config.num_frames, num_frames))
    frames = jnp.sort(frames, axis=-1)
    return frames, frames < limit, videos


def _turned(key: PRNGKeyArray, demos: DemoBatch) -> DemoBatch:
    """Each video under a random symmetry of the square; activity bits do not change."""
    sign_key, swap_key = jax.random.split(key)
    num = demos.length.shape[0]
    sign = jax.random.rademacher(sign_key, (num, 1, 1, 2), dtype=jnp.float32)
    swap = jax.random.bernoulli(swap_key, shape=(num, 1, 1, 1))
    center, size = (jnp.where(swap, x[..., ::-1], x) for x in (demos.center, demos.size))
    return demos._replace(center=center * sign, size=size)


def _latents(params, demo, active, frames, hyper, config):
    """Latents (F, D), node embeddings (F, N, H) and nodes of a demonstration's `frames`."""

    def one(center, size, active):
        graph = scene_graph(center, size, demo.label, demo.is_robot, active, demo.present)
        nodes = encoder.node_embeddings(params, graph, config.encoder)
        latent = encoder.readout(params, nodes, graph, config.encoder, alpha=hyper.alpha)
        return latent, nodes, graph.nodes

    return jax.vmap(one)(demo.center[frames], demo.size[frames], active[frames])


def _losses(params, demos, active, frames, valid, hyper, config):
    """Cycle-consistency, time agreement and reconstruction of a batch of videos."""

    def video(demo, active, frames):
        latents, embeddings, nodes = _latents(params.encoder, demo, active, frames, hyper, config)

        def rebuild(embedding, nodes):
            box, logits = decode(params.decoder, embedding, config.encoder)
            return reconstruction(box, logits, nodes, length_unit=config.encoder.length_unit)

        return latents, jax.vmap(rebuild)(embeddings, nodes)

    latents, rebuilt = jax.vmap(video)(demos, active, frames)
    times = frames / demos.length[:, None]
    cycle, agreement = mean_consistency(latents, times, valid, temperature=hyper.temperature)
    counted = valid[:, :, None] & demos.present[:, None, :]
    total = jnp.sum(jnp.where(counted, rebuilt, 0.0))
    return cycle, agreement, total / jnp.maximum(jnp.sum(counted), 1)
