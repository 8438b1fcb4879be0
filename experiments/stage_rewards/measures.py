"""What the reward of a stage is worth: its order along held-out segments, and of made-up states.

A made-up state is one in which the stage is not done, as the task's own stages tell: of two kinds,
segments' ends with displaced objects (`gril_jax.pretraining.copies`), and what gradient ascents
(`gril_jax.audit.ascent`) from segments' beginnings find. Shapes use B for segments, T for frames
and N for objects.
"""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax import metrics
from gril_jax.audit import ascent
from gril_jax.audit.scene_reward import Scene, SceneReward, scene_reward
from gril_jax.encoders.encoder import GraphConfig
from gril_jax.pretraining.copies import Ends, displaced
from gril_jax.types import DemoBatch

from .segments import scenes
from .ways import StageReward

_NEARLY = 0.05  # of the range: an end that is outbid by no more is still the best


class Along(NamedTuple):
    """Along held-out segments."""

    tau: Float[Array, ""]  # Kendall's, of the reward against time
    end_is_best: Float[Array, ""]  # share of segments with nearly no frame paid more than the last
    range: Float[Array, ""]  # mean last reward less mean first


class Soundness(NamedTuple):
    """Against made-up states in which the stage is not done; NaN where there are none."""

    order: Float[Array, ""]  # share of pairs with an end in which the end is paid more
    outbid: Float[Array, ""]  # share that is paid more than the worst end, without the ascents
    hack_gap: Float[Array, ""]  # worst end less the best made-up one, ascents too; in ranges
    made_up: Int[Array, ""]  # number, without the ascents


def paid_by(encoder: GraphConfig) -> SceneReward:
    """(`StageReward`, state) -> reward."""
    learned = scene_reward(encoder)
    return lambda stage, scene: jnp.maximum(learned(stage.learned, scene), stage.floor)


@functools.partial(jax.jit, static_argnames="encoder")
def along(
    stage: StageReward, films: DemoBatch, bits: Bool[Array, "B T N"], *, encoder: GraphConfig
) -> Along:
    """The measures along segments."""
    pay = functools.partial(paid_by(encoder), stage)
    paid = jax.lax.map(jax.vmap(pay), scenes(films, bits))
    last = jnp.take_along_axis(paid, films.length[:, None] - 1, axis=1)[:, 0]
    span = jnp.mean(last - paid[:, 0])
    within = jnp.arange(paid.shape[1]) < films.length[:, None]
    best = jnp.max(paid, where=within, initial=-jnp.inf, axis=1)
    tau = jax.vmap(metrics.reward_time_tau)(paid, films.length)
    return Along(jnp.mean(tau), jnp.mean(last >= best - _NEARLY * span), span)


@functools.partial(jax.jit, static_argnames=("encoder", "task", "least", "number", "ascents"))
def soundness(
    stage: StageReward,
    key: PRNGKeyArray,
    films: DemoBatch,
    bits: Bool[Array, "B T N"],
    order: Int[Array, "N"],
    places: Ends,
    span: Float[Array, ""],
    *,
    encoder: GraphConfig,
    task: Stages,
    least: int,
    number: int,
    ascents: int,
) -> Soundness:
    """The measures against made-up states.

    Args:
      stage, films, bits: the reward, and held-out segments.
      key: of the states, which are the same for all rewards but for ascents; consumed.
      order: where films have the task's objects.
      places: of the films' ends, for objects to be put near.
      span: of `Along`.
      encoder, task: of the reward, and the stages of the task.
      least: how many of these are done where this stage is.
      number: of displaced copies.
      ascents: from each segment's beginning.
    """
    pay = functools.partial(paid_by(encoder), stage)
    every, rows = scenes(films, bits), jnp.arange(len(films.length))
    begin = jax.tree.map(lambda x: x[:, 0], every)
    end = jax.tree.map(lambda x: x[rows, films.length - 1], every)
    extent, unit = jnp.max(jnp.abs(films.center)), encoder.length_unit

    def copy(key, film):
        scene, demo = (jax.tree.map(lambda x: x[film], tree) for tree in (end, films))
        made = displaced(key, *_boxes(scene), demo, places, extent, unit)
        return scene._replace(center=made.center, size=made.size, active=made.active)

    copy_key, ascent_key = jax.random.split(key)
    which = jnp.arange(number) % len(films.length)
    made = jax.vmap(copy)(jax.random.split(copy_key, number), which)
    undone = jax.vmap(lambda s: _done(task, _ordered(s, order)) < least)
    paid, amiss, ends = jax.vmap(pay)(made), undone(made), jax.vmap(pay)(end)
    one_stage = dataclasses.replace(
        task, score=lambda task, *boxes: (task.done(*boxes).sum() >= least).astype(jnp.float32)
    )

    def climb(key, start):
        known = lambda stage, s: pay(s._replace(active=s.active | start.active))  # noqa: E731
        return ascent.search(known, stage, key, one_stage, start, ascents=ascents).reward

    keys, starts = jax.random.split(ascent_key, len(rows)), _ordered(begin, order)
    found = jax.lax.map(lambda x: climb(*x), (keys, starts))
    climbed = jnp.max(found, where=undone(begin)[:, None], initial=-jnp.inf)
    best = jnp.maximum(jnp.max(paid, where=amiss, initial=-jnp.inf), climbed)
    count = jnp.sum(amiss)
    share = lambda x: jnp.sum(x & amiss) / count  # noqa: E731
    right = jnp.sum((ends[:, None] > paid) & amiss) / (count * len(ends))
    return Soundness(right, share(paid > ends.min()), (ends.min() - best) / span, count)


def done_at(task: Stages, films: DemoBatch, order: Int[Array, "N"], at) -> Int[Array, "B"]:
    """How many of the task's stages are done in one frame of each film."""
    rows = jnp.arange(len(films.length))
    boxes = films.center[rows, at][:, order], films.size[rows, at][:, order]
    return jax.vmap(task.done)(*boxes).sum(axis=-1)


def _boxes(scene: Scene):
    return scene.center, scene.size, scene.active


def _ordered(scene: Scene, order: Int[Array, "N"]) -> Scene:
    """Scenes with the objects in the task's order; before them at most one axis."""
    return jax.tree.map(lambda x: jnp.take(x, order, axis=scene.active.ndim - 1), scene)


def _done(task: Stages, scene: Scene) -> Int[Array, ""]:
    return task.done(scene.center, scene.size).sum()
