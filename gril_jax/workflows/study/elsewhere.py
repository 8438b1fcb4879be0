"""Rewards of a study in variants of their task that the videos do not show.

Shapes use S for rewards, B for starts, K for states and N for objects.
"""

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

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
    """The share of pairs of a success and another state of its start that a reward has in order.

    So many starts of each variant are drawn, and so many states made of each."""

    name, words, compiled = "elsewhere", "rewards in other variants", True

    def __init__(self, *, starts: int = 64, states: int = 256) -> None:
        self.starts, self.states = starts, states
        self._made: dict[Hashable, dict[str, States]] = {}

    def asked(self, config: RunConfig) -> bool:
        """True for a task that scores a state with its things in other places."""
        env = setup.make_env(config.env, training=False)
        return getattr(env, "shifted", None) is not None

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
        for name, states in self._by_variant(config).items():
            with jax.debug_nans(False):  # a start may have no success among its states
                of_start = [np.asarray(x) for x in programs[0](params, states)]
            if np.isfinite(of_start[0]).any():
                means = [np.nanmean(x, axis=1).tolist() for x in of_start]
                known[f"ranks_{name}"], known[f"best_{name}"] = means
        return known

    def _by_variant(self, config: RunConfig) -> dict[str, States]:
        """The same states for all rewards of a task."""
        key = task_key(config)
        if key not in self._made:
            names = registry.build(config.env.name, {}).variants
            self._made[key] = {
                name: jax.jit(self._states(_variant(config, name)))(jax.random.key(number))
                for number, name in enumerate(names)
            }
        return self._made[key]

    def _states(self, env: Env):
        """A function from a key to states of a variant."""
        kinds = jnp.asarray(_kinds(env.classes))
        regions = sum(name.endswith("region") for name in env.object_names)

        def of_start(key):
            key_reset, key_made = jax.random.split(key)
            begun = env.reset(key_reset)
            seen = begun.objects
            start = elsewhere.Start(
                seen.center, seen.size, kinds[seen.label], regions=regions, arena=env.arena
            )
            center = elsewhere.arrangements(key_made, start, self.states)
            could = jax.vmap(lambda c: elsewhere.possible(c, start))(center)
            score = jax.vmap(lambda c: env.shifted(begun, c).metrics["success"])(center)
            active = jnp.abs(center - seen.center).max(axis=-1) > _MOVED
            same = lambda x: jnp.broadcast_to(x, (self.states, *x.shape))  # noqa: E731
            scene = Scene(center, *map(same, (seen.size, seen.label, seen.is_robot)), active)
            return States(scene, score > 0.5, could)

        return lambda key: jax.vmap(of_start)(jax.random.split(key, self.starts))


def _kinds(classes: Sequence[str]) -> Int[np.ndarray, "C 2"]:
    """Colour and shape of each class of blocks, each counted from 0; 0 of robot and regions."""
    words, found = np.asarray(words_of(classes)), np.zeros((len(classes), 2), int)
    blocks = [i for i, name in enumerate(classes) if " " in name and not name.endswith("region")]
    for k in range(2):
        found[blocks, k] = np.unique(words[blocks, k], return_inverse=True)[1]
    return found


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
