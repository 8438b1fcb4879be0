"""Control steps per second of a task, random actions in parallel episodes.

    gril bench env                      MatchRegions with the default setting
    gril bench env --settings      what each setting of the solver and each engine gives
    gril bench env --task shoes_in_box --settings   the same there

What needs Warp is left out where it is not installed. Throughput is the best of some runs of a
compiled scan, of all cases in turn, and `finite` the share of episodes whose numbers all are. One
of MatchRegions takes about 15 s on 2 CPU cores, of the shoes longer.
"""

import importlib.util
import itertools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import envs
from gril_jax.workflows.build import setup

from .frame import compile_timed, speeds

_REPEATS = 5


def main(*, task: str, num_envs: int | None, steps: int, settings: bool) -> dict[str, Any]:
    """The figures of the default setting, or of every one."""
    spec = envs.spec(task)
    num_envs = num_envs or (256 if jax.default_backend() == "cpu" else spec.bench_envs)
    cases = spec.bench_settings if settings else ({},)
    if importlib.util.find_spec("warp") is None:
        cases = [case for case in cases if not _needs_warp(case)]
    made = [_Case(task, num_envs, steps, case) for case in cases]
    calls = {str(case.options): case for case in made}
    speed = speeds(calls, dict.fromkeys(calls, num_envs * steps), _REPEATS)
    return {"task": task, "cases": [case.figures(speed[name]) for name, case in calls.items()]}


def _needs_warp(options: Mapping[str, Any]) -> bool:
    return options.get("impl") == "warp" or options.get("engine") == "kernel"


class _Case:
    """One setting: a call plays so many control steps of episodes that go on and on."""

    def __init__(self, task: str, num_envs: int, steps: int, options: Mapping[str, Any]):
        self.options, self.num_envs = dict(options), num_envs
        if options.get("impl") == "warp":
            self.options["worlds"] = num_envs
        env = setup.build(task, self.options)
        self._state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), num_envs))
        self._numbers = itertools.count()

        def play(state, key):
            def move(state, key):
                action = jax.random.uniform(key, (num_envs, env.action_size), minval=-1.0)
                return jax.vmap(env.step)(state, action), None

            return jax.lax.scan(move, state, jax.random.split(key, steps))[0]

        self._program, self._compile_s = compile_timed(
            play, self._state, jax.random.key(0), plain=True
        )

    def __call__(self) -> Any:
        self._state = self._program(self._state, jax.random.key(next(self._numbers)))
        return self._state

    def figures(self, speed: float) -> dict[str, Any]:
        """The benchmark's entry for it, given its control steps a second."""
        return {
            "options": self.options,
            "num_envs": self.num_envs,
            "control_steps_per_s": round(speed),
            "compile_s": round(self._compile_s, 2),
            "finite": _finite(self._state),
        }


def _finite(states: Any) -> float:
    """Share of episodes."""
    leaves = [np.asarray(x) for x in jax.tree.leaves(states)]
    found = [np.isfinite(x).reshape(len(x), -1).all(1) for x in leaves if x.dtype == jnp.float32]
    return float(np.all(found, axis=0).mean())
