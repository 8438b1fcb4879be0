"""The reward that trains a policy: its function, its parameters, and the stages that it tells."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt8

from gril_jax import envs, reward
from gril_jax.config import RunConfig
from gril_jax.config.tables import REWARDS, find
from gril_jax.demos.tracking.held import with_held
from gril_jax.encoders.encoder import PixelConfig
from gril_jax.errors import ConfigError, DemoError, RunError
from gril_jax.graphs import activity
from gril_jax.pretraining import pretrain
from gril_jax.reward import staircase
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.rl import reward_gradient, rewards, starts
from gril_jax.subtasks import agreement
from gril_jax.types import DemoBatch

from . import setup

_MOST = 8  # stages
_FAR = 2.0  # world units
_NUM_FRAMES = 2048  # that training may begin at
_WEIGHTS = (10.0, 1.0)  # of the learned reward as a potential, and of the task's own


class RewardForm(NamedTuple):
    """One entry of the table `REWARDS`."""

    function: Callable[[RunConfig, envs.Env], rewards.AnyReward]
    """The reward as the algorithms take it."""
    parameters: Callable[[RunConfig, RewardParams, DemoBatch | None, int], Any]
    """Its parameters, from a learned reward, the demonstrations that it was learned from (None for
    shapes alone), and the number of classes."""
    learned_of: Callable[[Any], RewardParams] | None = None
    """Those of the learned reward among its parameters; None if it has none."""


def function(config: RunConfig, env: envs.Env) -> rewards.AnyReward:
    """The reward as the algorithms take it."""
    found = _form(config).function(config, env)
    if getattr(config, config.run.algorithm).observe_gradient:
        found = _with_gradient(config, env, found)
    return starts.with_frames(found) if begins_at_frames(config) else found


def _with_gradient(
    config: RunConfig, env: envs.Env, reward: rewards.AnyReward
) -> rewards.AnyReward:
    """The same reward, whose gradient the policy sees."""
    learned_of, wanted = _form(config).learned_of, f"{config.run.algorithm}.observe_gradient"
    if learned_of is None:
        raise ConfigError(
            f"{wanted} is true, but must be false for run.reward {config.run.reward!r}, since only "
            "a learned reward has a gradient"
        )
    if isinstance(setup.encoder_config(config, len(env.classes)), PixelConfig):
        raise ConfigError(
            f"{wanted} is true, but must be false for encoder.kind 'pixels', whose reward sees "
            "pictures and not the objects' boxes"
        )
    own = _learned(config, env)
    shown = jax.eval_shape(env.reset, jax.random.key(0)).objects
    return reward_gradient.observed(
        reward, lambda params, *seen: own(learned_of(params), *seen), len(shown.center)
    )


def parameters(
    config: RunConfig, learned: RewardParams | None, demos: DemoBatch | None, num_classes: int
) -> Any:
    """Its parameters, from a learned reward and its demonstrations; without these, the shapes.

    Raises RunError if the learned reward is not finite."""
    if not all(np.isfinite(x).all() for x in jax.tree.leaves(jax.device_get(learned))):
        raise RunError(
            "the learned reward is not finite, so no policy can be trained on it: learn it again "
            "with lower weights of the section loss"
        )
    found = _form(config).parameters(config, learned, demos, num_classes)
    return starts.WithFrames(found, _frames(config, demos)) if begins_at_frames(config) else found


def blank(config: RunConfig, env: envs.Env) -> Any:
    """Parameters of the right shapes, to restore a checkpoint into."""
    classes = len(env.classes)
    return parameters(config, setup.blank_reward(config, classes), None, classes)


def begins_at_frames(config: RunConfig) -> bool:
    """True if training episodes may begin at frames of the demonstrations."""
    return getattr(config, config.run.algorithm).video_state_resets > 0


def _frames(config: RunConfig, demos: DemoBatch | None) -> starts.Frames:
    """Frames of the demonstrations, evenly over all of them, with the objects in the task's order;
    without these, the shapes."""
    label, there = _labels(config)
    knows = hasattr(setup.make_env(config.env, training=False), "place_held")
    if demos is None:
        boxes, none = (jnp.zeros((_NUM_FRAMES, len(label), *end)) for end in ((2,), ()))
        return starts.Frames(boxes, boxes, none > 0, none > 0 if knows else None)
    active = jax.jit(jax.vmap(functools.partial(activity.trajectory, **config.pool.rule())))(
        demos.center, demos.size
    )
    center, size, held = _with_held(demos) if knows else (demos.center, demos.size, None)
    shown = np.flatnonzero(there)
    order = np.array([in_the_order_of(label[there], film) for film in np.asarray(demos.label)])
    film, frame = np.nonzero(np.arange(demos.center.shape[1]) < np.asarray(demos.length)[:, None])
    every = np.linspace(0, len(film) - 1, _NUM_FRAMES).round().astype(int)
    film, frame = film[every], frame[every]
    at = film[:, None], frame[:, None], order[film]
    seen = starts.Frames(
        *(None if x is None else jnp.asarray(x)[at] for x in (center, size, active, held))
    )
    if there.all():
        return seen
    # What the task does not show at its start is where no video has anything, without a size.
    far, none = jnp.full((len(film), len(label), 2), _FAR), jnp.zeros((len(film), len(label)))
    return starts.Frames(
        far.at[:, shown].set(seen.center), jnp.zeros_like(far).at[:, shown].set(seen.size),
        (none > 0).at[:, shown].set(seen.active),
    )  # fmt: skip


def _with_held(demos: DemoBatch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres and sizes (B, T, N, 2), whole ones of what a hand holds, and a mask of that."""
    center, size = np.array(demos.center), np.array(demos.size)
    held = np.zeros(center.shape[:3], bool)
    for video, length in enumerate(np.asarray(demos.length).tolist()):
        parts = np.flatnonzero(demos.is_robot[video] & demos.present[video]).tolist()
        found = with_held(center[video, :length], size[video, :length], parts)
        for every, some in zip((center, size, held), found, strict=True):
            every[video, :length] = some
    return center, size, held


def _labels(config: RunConfig) -> tuple[Int[np.ndarray, "N"], Bool[np.ndarray, "N"]]:
    """The classes of the task's objects in Demo, in its order, and which of them are there.

    Videos show these, whatever the variant samples (`place` ensures that)."""
    counts = config.env.variant in ("countplus", "all")
    room = ("padded=True",) if counts and "padded" in envs.options(config.env.name) else ()
    options = (*config.env.options, *room)
    shown = dataclasses.replace(config.env, variant="demo", options=options)
    env = setup.make_env(shown, training=False)
    seen = jax.jit(lambda key: env.reset(key).objects)(jax.random.key(0))
    return np.asarray(seen.label), np.asarray(seen.size).any(axis=1)


def in_the_order_of(task: Int[np.ndarray, "N"], film: Int[np.ndarray, "M"]) -> Int[np.ndarray, "N"]:
    """Where a video has the objects of a task; objects of one class keep the video's order."""
    if sorted(task) != sorted(film):
        raise DemoError(
            "training cannot begin at frames of the demonstrations, which show other objects than "
            "the task has: video_state_resets must be 0"
        )
    order = np.empty(len(task), int)
    order[np.argsort(task, kind="stable")] = np.argsort(film, kind="stable")
    return order


def _form(config: RunConfig) -> RewardForm:
    return find(REWARDS[config.run.reward_form].form)


def robots(env: envs.Env) -> tuple[int, ...]:
    """Indices of the robot's objects; empty for a task without stages."""
    stages = getattr(env, "stages", None)
    return stages.robots if stages else ()


def _learned(config: RunConfig, env: envs.Env) -> rewards.RewardFn:
    """The learned reward alone."""
    encoder = setup.encoder_config(config, len(env.classes))
    if isinstance(encoder, PixelConfig):
        several = jax.device_count() > 1
        return rewards.pixels(encoder, _picture(config, encoder.pixels), side_by_side=several)
    return rewards.learned(encoder, robots=robots(env))


def _picture(config: RunConfig, pixels: int) -> Callable[[Any], UInt8[Array, "P P 3"]]:
    """The task's picture of a state, with smooth edges as in the demonstration videos."""
    env, border = setup.make_env(config.env, training=False), setup.picture_border(pixels)
    if not hasattr(env, "render"):
        raise ConfigError(
            f"encoder.kind is 'pixels', but must be 'paper', 'interaction' or 'mlp' to train a "
            f"policy for {config.env.name}, which has no pictures inside compiled code"
        )
    inner = slice(border, border + pixels)
    return lambda data: env.render(data, size=pixels + 2 * border, antialias=True)[inner, inner]


def _of_shaped(config, learned, demos, num_classes):
    discounting = getattr(config, config.run.algorithm).discounting
    return jnp.asarray(_WEIGHTS, jnp.float32), jnp.float32(discounting), learned


def _agreed(config: RunConfig, learned: RewardParams, demos: DemoBatch, num_classes: int):
    """The ends of stages on which the demonstrations agree."""
    static = setup.embedding_config(config, num_classes)
    hyper = setup.pretrain_hyper(config)

    @jax.jit
    def find(learned, demos):
        latents = pretrain.embed(learned.encoder, demos, hyper, static)
        profiles = reward.latent_reward(learned, latents)
        return agreement.agreed_stages(profiles, demos.length)[1]

    return find(learned, demos)


def _stages(config: RunConfig, env: envs.Env) -> rewards.AnyReward:
    encoder = setup.encoder_config(config, len(env.classes))
    return rewards.stages(encoder, robots=robots(env), by=config.run.reward_offset)


def _of_stages(config, learned, demos, num_classes):
    if demos is None:
        none = jnp.zeros(_MOST)
        return learned, staircase.Staircase(none, none, jnp.zeros((), jnp.int32))
    found = _agreed(config, learned, demos, num_classes)
    return learned, staircase.from_levels(found.level[:_MOST], found.kept[:_MOST])


ENVIRONMENTAL = RewardForm(lambda *_: rewards.environmental, lambda *_: ())
LEARNED = RewardForm(
    lambda config, env: rewards.offset(_learned(config, env), config.run.reward_offset),
    lambda config, learned, demos, num_classes: learned,
    lambda params: params,
)
SHAPED = RewardForm(
    lambda config, env: rewards.shaped(_learned(config, env)), _of_shaped, lambda params: params[2]
)
STAGES = RewardForm(_stages, _of_stages, lambda params: params[0])


def stages_of(reward_params: Any) -> staircase.Staircase | None:
    """The stages among a policy reward's parameters; None if the reward has none."""
    params = reward_params.reward if isinstance(reward_params, starts.WithFrames) else reward_params
    last = params[-1] if isinstance(params, tuple) and params else None
    return last if isinstance(last, staircase.Staircase) else None


def stages_note(config: RunConfig, reward_params: Any) -> str | None:
    """A sentence if the demonstrations agree on another number of stages than there are
    sub-policies, else None."""
    found, asked = stages_of(reward_params), config.sub_policies
    if found is None or asked in (1, int(found.count)):
        return None
    if int(found.count) == 1:
        return (
            "the reward has one stage, so this is a one-stage task: one policy learns it, and "
            f"{asked - 1} of {asked} sub-policies have nothing to do"
        )
    return (
        f"the demonstrations agree on {int(found.count)} stages, which {asked} sub-policies share "
        f"out: --ppo.sub-policies {int(found.count)} gives each stage its own"
    )


def stages_finished(reward_params: Any, remembered: Float[Array, "E T K"]) -> list[float]:
    """The share of episodes that finished each stage; empty without stages."""
    found = stages_of(reward_params)
    if found is None:
        return []
    each = _index(found, np.asarray(remembered)[:, -1])
    return [float(np.mean(each > stage)) for stage in range(int(found.count))]


def stages_in_words(reward_params: Any, remembered: Float[Array, "T K"]) -> list[str]:
    """The stage of an episode before its first step and after each, (T + 1); empty without
    stages."""
    found = stages_of(reward_params)
    if found is None:
        return []
    count = int(found.count)
    each = [0, *_index(found, np.asarray(remembered))]
    return [f"stage {n + 1} of {count}" if n < count else "all stages done" for n in each]


def _index(found: staircase.Staircase, remembered: Float[np.ndarray, "... K"]) -> np.ndarray:
    return np.round(remembered[..., -1] * int(found.count)).astype(int)
