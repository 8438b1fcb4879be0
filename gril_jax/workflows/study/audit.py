"""The audit of a study's rewards, in one program for all that are of one form.

Shapes use S for rewards.
"""

import functools
from collections.abc import Hashable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax import envs
from gril_jax.audit import measures as audit_measures
from gril_jax.audit.made import States, make_states
from gril_jax.audit.scene_reward import Scene, StagedTask, scene_reward
from gril_jax.audit.shortfalls import KINDS
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.encoders.encoder import GraphConfig
from gril_jax.errors import ConfigError, RunError
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.workflows import held_out
from gril_jax.workflows.build import setup
from gril_jax.workflows.learning.encoders import stack

from .measures import Gather, Measure, num_classes
from .rewards import task_key

OWN = "own"  # in place of a variant: that in which policies are trained

# Short names of what is kept of `gril_jax.audit.measures.Measures`.
FIGURES = {
    "order": "order_accuracy",
    "touch": "touch_share",
    "push": "push_share",
    "hack_gap": "hack_gap",
    "hack_share": "hack_share",
    "misranked": "misranked_share",
    "kept": "success_kept",
}


class Ground(NamedTuple):
    """The states that rewards are audited on; the same for all."""

    task: StagedTask
    states: Mapping[str, States]  # by variant


class Audit(Measure):
    """The audit from so many starts of each variant of a row's task, and `held_out` figures.

    The starts share `ascents` gradient searches; None takes the configuration's `run.audit`.
    Without searches, or without stages, there is no audit."""

    name, words, compiled = "audit", "auditing the rewards", True

    def __init__(
        self,
        gather: Gather,
        *,
        variants: Sequence[str] = (OWN,),
        starts: int = 4,
        ascents: int | None = None,
    ) -> None:
        self.gather, self.variants, self.starts, self.ascents = gather, variants, starts, ascents
        self._made: dict[Hashable, Ground] = {}

    def asked(self, config):
        """True where it is asked for, and the task has stages."""
        own = setup.make_env(config.env, training=False)
        staged = getattr(own, "stages", None) is not None
        return bool(self.ascents or (config.run.audit and staged))

    def same(self, config):
        """The task, the reward's form and the number of gradient searches."""
        form = setup.reward_form(config, num_classes(config.env))
        return task_key(config), form, self.ascents or config.run.audit

    def lower(self, config, params):
        """One program, for all variants."""
        _, (encoder, *_), ascents = self.same(config)
        where = self._ground(config)
        run = audit_program(encoder, where.task, ascents=ascents)
        return [run.lower(params, next(iter(where.states.values())))]

    def measure(self, programs, config, found):
        """The figures of each reward."""
        params = stack([one.params for one in found])
        values = audit_figures(*programs, params, self._ground(config))
        videos = held_out.measured(config, self.gather(config), [one.params for one in found])
        along = {name: [one[name] for one in videos] for name in videos[0]}
        return {name: x.tolist() for name, x in values.items()} | along

    def _ground(self, config: RunConfig) -> Ground:
        """The same states for all rewards of a task."""
        key = task_key(config), config.env.variant if OWN in self.variants else None
        if key not in self._made:
            tasks = audited_tasks(config.env, self.variants)
            self._made[key] = ground(tasks, starts=self.starts)
        return self._made[key]


def audited_tasks(config: EnvConfig, variants: Sequence[str]) -> dict[str, envs.Env]:
    """The task in each variant; ConfigError if it lacks one of them, or a stage definition
    for it."""
    found = {name: setup.staged_env(config, None if name == OWN else name) for name in variants}
    if any(getattr(env, "stages", None) is None for env in found.values()):
        raise ConfigError(f"env.name is {config.name!r}, but must be a task with stages")
    return found


def ground(variants: Mapping[str, envs.Env], *, starts: int) -> Ground:
    """Synthetic states around some starts of each variant, which come from `audited_tasks`."""
    found = {}
    for number, (variant, env) in enumerate(variants.items()):
        keys = jax.random.split(jax.random.key(number), 2 * starts)
        found[variant] = jax.jit(functools.partial(_states, env))(keys[:starts], keys[starts:])
    return Ground(next(iter(variants.values())).stages, found)


def _states(env: envs.Env, reset_keys, state_keys) -> States:
    begin = jax.vmap(env.reset)(reset_keys).objects
    resting = jnp.zeros(begin.label.shape, bool)
    scene = Scene(begin.center, begin.size, begin.label, begin.is_robot, resting)
    return jax.vmap(functools.partial(make_states, task=env.stages))(state_keys, scene)


def audit_program(encoder: GraphConfig, task: StagedTask, *, ascents: int):
    """The jitted audit of many rewards, (parameters, states) -> measures; for any variant."""

    @jax.jit
    def run(params, states):
        def one(params):
            reward, key = scene_reward(encoder), jax.random.key(0)
            found = audit_measures.audit(reward, params, key, task, states, ascents=ascents)
            return found.measures

        return jax.vmap(one)(params)

    return run


def audit_figures(run: Any, params: RewardParams, on: Ground) -> dict[str, Float[np.ndarray, "S"]]:
    """The figures of S rewards, such as `hack_share_layout`, and the misranked successes of each
    kind of shortfall, such as `misranked_just_outside_layout`.

    Raises RunError if a reward is not finite in one of the states.
    """
    with jax.debug_nans(False):  # a share of nothing is NaN
        found = {variant: run(params, states) for variant, states in on.states.items()}
    for variant, measures in found.items():
        lost = np.flatnonzero(~np.asarray(measures.finite))
        if len(lost):
            raise RunError(
                f"the reward of seed {lost[0]} of {len(measures.finite)}, counted from 0, is not "
                f"finite in some state of the variant {variant}, so it cannot be audited"
            )
    figures = {
        f"{name}_{variant}": np.asarray(getattr(measures, field))
        for variant, measures in found.items()
        for name, field in FIGURES.items()
    }
    return figures | {
        f"misranked_{kind.replace(' ', '_')}_{variant}": np.asarray(measures.misranked[:, i])
        for variant, measures in found.items()
        for i, kind in enumerate(KINDS)
    }
