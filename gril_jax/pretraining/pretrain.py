"""Trains the encoder on demonstrations: cycle-consistency plus reconstruction (Eq. 6).

    config = Static(encoder=EncoderConfig(num_classes=7))
    state = init(key, demos, config)
    for _ in range(20):
        state, metrics = step(state, demos, Hyper(), config)
    evaluate(state.params.encoder, held_out, demos, Hyper(), config)

Every function is pure and can be jitted, and vmapped over seeds (the key or the state) and over
the values in `Hyper`. The members of an ensemble are trained each by itself, as states of their
own; `embed` and `evaluate` take the whole of it. Shapes use B for demonstrations, V for the videos
of a batch, T and F for frames, N for objects, H for the node embedding and D for the latent.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax import metrics, reward
from gril_jax.audit.scene_reward import Scene
from gril_jax.config.tables import ALIGNMENTS
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import Params
from gril_jax.encoders.ensemble import num_members
from gril_jax.errors import ConfigError
from gril_jax.graphs import activity
from gril_jax.losses import heads
from gril_jax.reward import RewardParams
from gril_jax.types import DemoBatch

from . import batch as pretrain_batch
from . import contrast as pretrain_contrast
from . import loss as pretrain_loss
from . import stages as pretrain_stages
from .arrangement import arrangement
from .batch import Ends
from .final_places import final_places
from .options import Hyper, Static

# Adam without its step size, which is traced; norms are clipped against rare long steps.
ADAM = optax.chain(optax.clip_by_global_norm(1.0), optax.scale_by_adam())
# All parameters lie in one vector: leaf by leaf it is a fifth of the program to compile.
_OPTIMIZER = optax.flatten(ADAM)


class TrainParams(NamedTuple):
    """Trained parameters. The reward needs the encoder, and the head if there is one."""

    encoder: Params
    decoder: Params
    head: heads.Head | None = None


class TrainState(NamedTuple):
    """Everything the next update depends on; saving it is enough to resume bit for bit."""

    params: Any  # `TrainParams`, or those of a pixel encoder
    optimizer: optax.OptState
    key: PRNGKeyArray
    num_updates: Int[Array, ""]


class Metrics(NamedTuple):
    """One value for each update of a `step`."""

    loss: Float[Array, "updates"]  # Eq. 6, plus the fading time agreement
    consistency: Float[Array, "updates"]  # squared error of normalised time, or soft-DTW
    reconstruction: Float[Array, "updates"]
    contrast: Float[Array, "updates"]  # 0 without copies and pool
    gradient_norm: Float[Array, "updates"]


class Part(NamedTuple):
    """The updates of a `step` that a call makes, from `first` to before `last`; both are traced, so
    that where a step is cut into calls changes no number."""

    metrics: Any  # of the updates before them, in arrays with room for all
    first: Int[Array, ""]
    last: Int[Array, ""]


def no_metrics(kind: type, updates: int) -> Any:
    """The metrics of a step before its first update."""
    return kind(*[jnp.zeros((updates,), jnp.float32)] * len(kind._fields))


def repeated(update: Any, state: TrainState, updates: int, part: Part | None) -> tuple[Any, Any]:
    """The state after all updates of a step, or a part of them, and metrics of those so far."""
    if part is None:
        return jax.lax.scan(update, state, length=updates)

    def one(number, carry):
        state, metrics = carry
        state, values = update(state, None)
        return state, jax.tree.map(lambda row, x: row.at[number].set(x), metrics, values)

    return jax.lax.fori_loop(part.first, part.last, one, (state, part.metrics))


@jax.jit
def init(key: PRNGKeyArray, demos: DemoBatch, config: Static) -> TrainState:
    """Fresh parameters and optimiser state. The key is consumed.

    Raises:
      ConfigError: a batch would hold more videos than there are demonstrations, or the encoder is
        an ensemble.
    """
    num_demos, members = demos.length.shape[0], num_members(config.encoder)
    if members > 1:
        raise ConfigError(
            f"encoder.ensemble_size is {members}, but must be 1 here: the members of an ensemble "
            "are trained each by itself."
        )
    if config.num_videos > num_demos:
        raise ConfigError(
            f"pretrain.num_videos is {config.num_videos} but there are {num_demos} "
            f"demonstrations; it must be at most their number."
        )
    encoder_key, decoder_key, key = jax.random.split(key, 3)
    params = TrainParams(
        encoder.init(encoder_key, config.encoder),
        pretrain_loss.init_decoder(decoder_key, config, demos.center.shape[2]),
        _head(jax.random.fold_in(decoder_key, 1), demos, config),
    )
    return TrainState(params, _OPTIMIZER.init(params), key, jnp.zeros((), jnp.int32))


def _head(key: PRNGKeyArray, demos: DemoBatch, config: Static) -> heads.Head | None:
    """The initial head of a method that predicts progress; None for other ones."""
    chosen = ALIGNMENTS[config.consistency]
    if not chosen.head:
        return None
    made = heads.of(config.consistency).init(key, config.encoder.latent)
    if not chosen.stages:
        return made
    return made._replace(proportions=pretrain_stages.found(demos).proportions)


def places(demos: DemoBatch, num_classes: int, config: Static) -> Ends:
    """The ends of demonstrations, from their last frames, as the options describe them.

    Raises:
      ConfigError: `goal_model` is "arrangement", and `words` are not of as many classes.
    """
    if config.goal_model != "arrangement":
        return final_places(
            demos, num_classes, turned=config.turn_scenes, trim_quantile=config.trim_quantile,
            anywhere_inside=config.goal_model == "inside",
        )  # fmt: skip
    if len(config.words) != num_classes:
        raise ConfigError(
            f"words has {len(config.words)} entries, but the encoder has {num_classes} classes; "
            "with goal_model 'arrangement' it must have one of each."
        )
    return arrangement(demos, config.words)


@jax.jit
def step(
    state: TrainState,
    demos: DemoBatch,
    hyper: Hyper,
    config: Static,
    pool: Scene | None = None,
    part: Part | None = None,
) -> tuple[TrainState, Metrics]:
    """`config.updates` gradient updates in one compiled call, or a part of them.

    `pool` are scenes that an earlier reward overestimated (`gril_jax.pretraining.hard_negatives`),
    leaves (P, N, ...); they teach distances as copies do, also without `num_perturbations`.

    Raises:
      ConfigError: as for `places`, or scenes are to teach distances to a head, which has none.
    """
    active = activity_bits(demos, hyper, config)
    ends = stages = None
    apart_too = config.num_perturbations > 0 or pool is not None
    chosen = ALIGNMENTS[config.consistency]
    if chosen.head and apart_too:
        raise ConfigError(
            f"consistency is {config.consistency!r}, whose reward is no distance, so there must be "
            "no pool, and num_perturbations must be 0."
        )
    if chosen.stages:
        stages = pretrain_stages.found(demos).times
    if apart_too:
        ends = places(demos, config.encoder.num_classes, config)

    def update(state, _):
        key, batch_key, turn_key, touch_key = jax.random.split(state.key, 4)
        frames, valid, videos = pretrain_batch.draw(
            batch_key, demos.length, demos.center.shape[1], config
        )
        batch, bits, due = jax.tree.map(lambda x: x[videos], (demos, active, stages))
        if config.turn_scenes:
            batch = pretrain_batch.turn(turn_key, batch)
        if config.random_activity > 0:
            bits = pretrain_batch.touch(touch_key, bits, config.random_activity)
        if config.rewind > 0:
            rewind_key = jax.random.fold_in(batch_key, 4)
            frames = pretrain_batch.rewound(rewind_key, frames, valid, config.rewind)

        fading = agreement_weight(state, hyper)

        def loss(params):
            cycle_key = jax.random.fold_in(batch_key, 2)  # `draw` splits it into 0 and 1
            data = batch, bits, frames, valid
            parts = pretrain_loss.terms(*params, cycle_key, *data, hyper, config, due)
            total = parts.consistency + hyper.lambda_ * parts.reconstruction
            apart = jnp.zeros(())
            if apart_too:
                copy_key = jax.random.fold_in(batch_key, 3)
                apart = pretrain_contrast.contrast(
                    params.encoder, copy_key, batch, bits, ends, hyper, config, pool
                )
                total = total + hyper.perturbation_weight * apart
            values = (parts.consistency, parts.reconstruction, apart)
            return total + fading * parts.agreement, values

        (total, parts), gradient = jax.value_and_grad(loss, has_aux=True)(state.params)
        params, moments = updated(_OPTIMIZER, state, gradient, hyper)
        values = Metrics(total, *parts, optax.tree.norm(gradient))
        return TrainState(params, moments, key, state.num_updates + 1), values

    return repeated(update, state, config.updates, part)


@jax.jit
def embed(params: Params, demos: DemoBatch, hyper: Hyper, config: Static) -> Float[Array, "B T D"]:
    """The latent of every frame of every demonstration, padding included; one at a time in memory.

    `params` are those of the encoder (`state.params.encoder`).
    """

    def one(demo_and_active):
        demo, active = demo_and_active
        frames = jnp.arange(demo.center.shape[0])
        return pretrain_loss.latents(params, demo, active, frames, hyper, config)[0]

    return jax.lax.map(one, (demos, activity_bits(demos, hyper, config)))


@jax.jit
def evaluate(
    params: Params,
    demos: DemoBatch,
    train: DemoBatch,
    hyper: Hyper,
    config: Static,
    head: heads.Head | None = None,
) -> dict[str, Float[Array, ""]]:
    """Measures how well the encoder orders demonstrations, ideally unseen ones.

    Goal and scale of the reward come from `train`, the training demonstrations; `params` are those
    of the encoder (`state.params.encoder`), and `head` is `state.params.head`.

    Returns:
      `tau`: Kendall's tau of nearest-neighbour alignment, mean over ordered pairs of `demos`; an
        ensemble's latents count side by side. One demonstration has none.
      `reward_time_tau`: Kendall's tau of the reward against time, mean over `demos`.
      `reward_first`, `reward_last`: mean reward at the first and the last frames.
      High values say that demonstrations are ordered, not that a reward is safe to optimise.
    """
    latents = embed(params, demos, hyper, config)
    learned = learned_reward(params, train, hyper, config, head)
    return figures(learned, latents, demos.length)


def learned_reward(
    params: Params,
    train: DemoBatch,
    hyper: Hyper,
    config: Static,
    head: heads.Head | None = None,
) -> RewardParams:
    """The reward of an encoder, and of its head if it has one: its goal is the mean of the training
    demonstrations' last latents, or `config.goals` of them."""
    bits = activity_bits(train, hyper, config)
    return reward.from_demos(
        params, train, config.encoder, alpha=hyper.alpha, active=bits, goals=config.goals, head=head
    )


def figures(
    learned: RewardParams, latents: Float[Array, "B T D"], length: Int[Array, "B"]
) -> dict[str, Float[Array, ""]]:
    """Scalar measures of a reward, from the latents of recordings; `evaluate` names them. One
    recording has no alignment tau."""
    rewards = reward.latent_reward(learned, latents)
    last = jnp.take_along_axis(rewards, length[:, None] - 1, axis=1)
    aligned = {"tau": metrics.mean_alignment_tau(latents, length)} if len(latents) > 1 else {}
    return aligned | {
        "reward_time_tau": metrics.time_order(rewards, length).reward_time_tau,
        "reward_first": jnp.mean(rewards[:, 0]),
        "reward_last": jnp.mean(last),
    }


def activity_bits(demos: DemoBatch, hyper: Hyper, config: Static) -> Bool[Array, "B T N"]:
    """The activity bits (Eq. 4) that training uses, for every frame of the recordings.

    They come from the full recordings: a bit that latched between two sampled frames is set.
    """
    rule = dict(window=config.window, smoothing=config.smoothing, noise=config.noise, tau=hyper.tau)
    return jax.vmap(functools.partial(activity.trajectory, **rule))(demos.center, demos.size)


def agreement_weight(state: TrainState, hyper: Hyper) -> Float[Array, ""]:
    """Of the time agreement, for the first updates only: see `gril_jax.losses.mean_consistency`."""
    done = state.num_updates.astype(float)
    fading = jnp.clip(1.0 - done / jnp.maximum(hyper.warmup, 1.0), 0.0, 1.0)
    return jnp.where(hyper.warmup > 0, fading, 0.0)


def updated(
    optimizer: optax.GradientTransformation, state: TrainState, gradient: Any, hyper: Hyper
) -> tuple[Any, optax.OptState]:
    """Parameters and moments after an update, whose step size falls linearly."""
    direction, moments = optimizer.update(gradient, state.optimizer, state.params)
    progress = jnp.minimum(state.num_updates.astype(float) / hyper.decay_updates, 1.0)
    rate = hyper.learning_rate * (1.0 - (1.0 - hyper.final_learning_rate_fraction) * progress)
    direction = jax.tree.map(lambda d: -rate * d, direction)
    return optax.apply_updates(state.params, direction), moments
