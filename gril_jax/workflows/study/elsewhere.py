"""Rewards of a study in variants of their task that the videos do not show.

Shapes use S for rewards, B for starts, K for states and N for objects.
"""

from collections.abc import Hashable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from gril_jax.audit import elsewhere
from gril_jax.audit.scene_reward import Scene, scene_reward
from gril_jax.config import RunConfig
from gril_jax.envs import Env, registry
from gril_jax.pretraining.arrangement import words_of
from gril_jax.workflows.build import setup
from gril_jax.workflows.learning.encoders import stack

from .measures import Measure, num_classes
from .rewards import task_key

_MOVED = 1e-4  # world units: less is rounding


class States(NamedTuple):
    """Made states of B starts, K of each."""

    scene: Scene  # leaves (B, K, N, ...)
    success: Bool[Array, "B K"]
    counted: Bool[Array, "B K"]  # states that could be


class Elsewhere(Measure):
    """How often a success has more reward than another made state of the same start, by variant.

    So many starts of each variant are drawn, and so many states made of each."""

    name, words, compiled = "elsewhere", "rewards in other variants", True

    def __init__(self, *, starts: int = 64, states: int = 256) -> None:
        self.starts, self.states = starts, states

    def asked(self, config: RunConfig) -> bool:
        """True for a task that scores a state with its things in other places."""
        return hasattr(setup.make_env(config.env, training=False), "shifted")

    def same(self, config: RunConfig) -> Hashable:
        """The task and the reward's form."""
        return task_key(config), setup.reward_form(config, num_classes(config.env))

    def lower(self, config, params):
        """One program, for all variants."""
        _, (encoder, *_) = self.same(config)
        states = jax.eval_shape(self._states(_variant(config, "all")), jax.random.key(0))
        return [_figures(encoder).lower(params, states)]

    def measure(self, programs, config, found):
        """The figures of each reward, such as `ranks_layout` and `best_layout`."""
        params = stack([one.params for one in found])
        known: dict[str, list[float]] = {}
        for number, name in enumerate(registry.build(config.env.name, {}).variants):
            states = jax.jit(self._states(_variant(config, name)))(jax.random.key(number))
            with jax.debug_nans(False):  # a start may have no success among its states
                of_start = programs[0](params, states)
            means = [np.nanmean(np.asarray(x), axis=1).tolist() for x in of_start]
            known[f"ranks_{name}"], known[f"best_{name}"] = means
        return known

    def _states(self, env: Env):
        """A function from a key to states of a variant."""
        words = jnp.asarray(words_of(env.classes))
        regions = sum(name.endswith("region") for name in env.object_names)

        def of_start(key):
            key_reset, key_made = jax.random.split(key)
            begun = env.reset(key_reset)
            seen = begun.objects
            start = elsewhere.Start(
                seen.center, seen.size, words[seen.label], regions=regions, arena=env.arena
            )
            center = elsewhere.arrangements(key_made, start, self.states)
            could = jax.vmap(lambda c: elsewhere.possible(c, start))(center)
            score = jax.vmap(lambda c: env.shifted(begun, c).metrics["success"])(center)
            active = jnp.abs(center - seen.center).max(axis=-1) > _MOVED
            same = lambda x: jnp.broadcast_to(x, (self.states, *x.shape))  # noqa: E731
            scene = Scene(center, *map(same, (seen.size, seen.label, seen.is_robot)), active)
            return States(scene, score > 0.5, could)

        return lambda key: jax.vmap(of_start)(jax.random.split(key, self.starts))


def _variant(config: RunConfig, name: str) -> Env:
    """The task in a variant, with as many objects as in any."""
    known = {"padded": True} if "padded" in registry.options(config.env.name) else {}
    options = setup.task_options(config.env, training=False, variant=name)
    return setup.build(config.env.name, options | known)


def _figures(encoder: Any):
    """Jitted program: (S rewards, states) -> figures (S, B)."""
    reward = scene_reward(encoder)

    @jax.jit
    def run(params, states: States) -> elsewhere.Ranked:
        def of_start(params, states):
            values = jax.vmap(lambda scene: reward(params, scene))(states.scene)
            return elsewhere.ranked(values, states.success, states.counted)

        def one(params):  # start after start, whose states together fill a device
            return jax.lax.map(lambda states: of_start(params, states), states)

        return jax.vmap(one)(params)

    return run
