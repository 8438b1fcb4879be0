"""Training of an encoder, on boxes or on frames, behind one interface.

The demonstrations' arrays are arguments and no constants: frames are too many for a program.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.audit.scene_reward import Scene
from gril_jax.config import RunConfig
from gril_jax.config.tables import ENCODERS
from gril_jax.demos.demo_set import demo_batch, frame_batch
from gril_jax.encoders.encoder import Params
from gril_jax.encoders.ensemble import member, num_members
from gril_jax.pretraining import pixel_pretrain, pretrain
from gril_jax.pretraining.pixel_pretrain import PixelStatic
from gril_jax.pretraining.pretrain import Hyper, Part, Static
from gril_jax.reward import pixels as pixel_reward
from gril_jax.reward.latent_goal import RewardParams

from . import demonstrations, setup


class Learner(NamedTuple):
    """Functions of a state, the data and the traced options: pure except `films`."""

    static: Static | PixelStatic
    data: Any  # training and held-out demonstrations, scenes to learn from, failures that teach
    init: Callable[[PRNGKeyArray, Any], Any]
    step: Callable[[Any, Any, Hyper, Part], tuple[Any, Any]]  # some of `static.updates` updates
    metrics: Any  # of a step before its first update
    reward: Callable[[Any, Any, Hyper], RewardParams]
    measure: Callable[[Any, Any, Hyper], dict[str, Float[Array, ""]]]
    latents: Callable[[Params, Any, Hyper], Float[Array, "B T D"]]  # of all frames of `films`
    films: Callable[[Sequence[str]], Any]  # arrays of demonstrations by name; may read files


def static_config(config: RunConfig, num_classes: int) -> Static | PixelStatic:
    """The static options of the encoder training in the configuration."""
    if ENCODERS[config.encoder.kind].boxes:
        return setup.embedding_config(config, num_classes)
    return setup.pixel_pretrain_config(config)


def learner(
    config: RunConfig, demos: demonstrations.Demonstrations, pool: Scene | None = None
) -> Learner:
    """The training of the configuration's encoder on some demonstrations.

    The pool, for boxes alone, holds scenes that earlier rewards overestimated. Raises ConfigError
    if a batch would hold more videos than there are, DemoError if one cannot be read.
    """
    boxes = ENCODERS[config.encoder.kind].boxes
    return _of_boxes(config, demos, pool) if boxes else _of_frames(config, demos)


def _of_boxes(config, demos, pool) -> Learner:
    classes = demos.demo_set.classes
    static = setup.pretrain_config(config, classes)
    init, step = _of_members(static)

    def learned(state, data, hyper):
        params = state.params
        return pretrain.learned_reward(params.encoder, data[0], hyper, static, params.head)

    return Learner(
        static,
        (demos.batch("train"), demos.batch("validation"), pool),
        init,
        step,
        pretrain.no_metrics(pretrain.Metrics, static.updates),
        learned,
        lambda state, data, hyper: pretrain.evaluate(
            state.params.encoder, data[1], data[0], hyper, static, state.params.head
        ),
        lambda params, films, hyper: pretrain.embed(params, films, hyper, static),
        lambda names: demo_batch(demos.demo_set, names),
    )


def _of_members(static: Static):
    """`init` and `step`; for an ensemble, those of its members, each with a separate key.

    Networks begin apart and sample other batches. The metrics are their means.
    """
    members = num_members(static.encoder)
    one = dataclasses.replace(static, encoder=member(static.encoder))

    def init(key, data):
        return pretrain.init(key, data[0], one)

    def step(state, data, hyper, part):
        return pretrain.step(state, data[0], hyper, one, data[2], part)

    def init_all(key, data):
        return jax.vmap(init, (0, None))(jax.random.split(key, members), data)

    def step_all(state, data, hyper, part):
        state, metrics = jax.vmap(step, (0, None, None, None))(state, data, hyper, part)
        at = jnp.arange(one.updates)
        new = (part.first <= at) & (at < part.last)
        mean = lambda old, x: jnp.where(new, jnp.mean(x, axis=0), old)  # noqa: E731
        return state, jax.tree.map(mean, part.metrics, metrics)

    return (init, step) if members == 1 else (init_all, step_all)


def _of_frames(config, demos) -> Learner:
    static = setup.pixel_pretrain_config(config)
    env, pixels = setup.task_of(config.env), config.encoder.pixels
    # No more than the pictures that give a policy its reward; else all that the videos show.
    half_extent = setup.seen_half_extent(env, pixels) if hasattr(env, "render") else None

    @functools.cache  # the seeds of a row are measured on the same videos
    def frames(*names):
        found = frame_batch(demos.demo_set, names, pixels=pixels, half_extent=half_extent)
        return jax.tree.map(jnp.asarray, found)

    return Learner(
        static,
        (frames(*demos.names["train"]), frames(*demos.names["validation"])),
        lambda key, data: pixel_pretrain.init(key, data[0], static),
        lambda state, data, hyper, part: pixel_pretrain.step(state, data[0], hyper, static, part),
        pretrain.no_metrics(pixel_pretrain.Metrics, static.updates),
        lambda state, data, hyper: pixel_reward.from_videos(state.params, data[0], static.encoder),
        lambda state, data, hyper: pixel_pretrain.evaluate(state.params, data[1], data[0], static),
        lambda params, films, hyper: pixel_reward.embed(params, films, static.encoder),
        lambda names: frames(*names),
    )
