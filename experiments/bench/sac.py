"""Our SAC beside a loop on the host, as users of Gymnasium write it.

    gril bench sac                      a minute on 2 CPU cores
    gril bench sac --target 0.9         and how long each takes to that success

Task: MatchRegions with one block. The loop has one environment; a jitted call acts, another steps,
the replay is NumPy's, and a third makes the same gradient step, as often for each control step.
Speeds leave out compiling, times to a success do not.
"""

import collections
import dataclasses
import functools
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.training.types import Transition
from gril_jax.envs import Env

from gril_jax.rl import policy, rewards, sac, sac_loss, training
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.starts import count_starts

from . import frame

_RECENT = 100  # episodes whose success counts
_REPEATS = 5  # timed calls of each
_LIMIT_S = 600.0  # after which either gives up


def main(*, num_envs: int, target: float | None) -> dict[str, Any]:
    """The figures of both; without a target, a success at which learning is over, speeds alone."""
    static = sac.Static(num_envs=num_envs, min_replay=2**12)
    hyper = sac.Hyper(learning_rate=1e-3, alpha_learning_rate=1e-3, discounting=0.97)
    env = setup.build("match_regions", {"targets": ("green square",), "distractors": ()})
    result = {"sizes": vars(static), "speeds": speeds(env, static, hyper, _REPEATS)}
    if target is not None:
        result["until_success"] = until_success(env, static, hyper, target, _LIMIT_S)
    return result


def speeds(env: Env, static: sac.Static, hyper: sac.Hyper, repeats: int) -> dict[str, Any]:
    """Control steps per second of both, interleaved; the best of some calls."""
    static = dataclasses.replace(static, min_replay=0)
    sides = {"ours": Ours(env, static, hyper), "host_loop": HostLoop(env, static, hyper)}
    calls = {name: side.advance for name, side in sides.items()}
    speed = frame.speeds(calls, {name: side.steps for name, side in sides.items()}, repeats)
    ratio = round(speed["ours"] / speed["host_loop"], 1)
    return {"steps_per_s": frame.rounded(speed, 0), "times_as_fast": ratio}


def until_success(
    env: Env, static: sac.Static, hyper: sac.Hyper, target: float, limit_s: float
) -> dict[str, Any]:
    """Seconds, compilation included, until the last 100 training episodes reach a success rate."""
    found = {}
    for name, side in {"ours": Ours, "host_loop": HostLoop}.items():
        jax.clear_caches()
        start, steps = time.perf_counter(), 0
        learner = side(env, static, hyper)
        while learner.success < target and time.perf_counter() - start < limit_s:
            learner.advance()
            steps += learner.steps
        found[name] = {
            "seconds": round(time.perf_counter() - start, 1),
            "steps": steps,
            "success": round(learner.success, 3),
            "reached": learner.success >= target,
        }
    counted = {"episodes": _RECENT, "starts": count_starts(env, _RECENT)}
    return {"target": target, "success_of": counted, "limit_s": limit_s, **found}


class _Learner:
    """A side that learns for some control steps a call, and counts the success of late episodes."""

    def __init__(self, steps: int) -> None:
        self.steps = steps
        self._recent: collections.deque[float] = collections.deque(maxlen=_RECENT)

    @property
    def success(self) -> float:
        full = len(self._recent) == _RECENT
        return sum(self._recent) / _RECENT if full else 0.0


class Ours(_Learner):
    """Our SAC; each call runs a chunk of updates."""

    def __init__(self, env: Env, static: sac.Static, hyper: sac.Hyper, updates: int = 10):
        super().__init__(updates * static.num_envs * static.unroll_length)
        algorithm = sac.SAC(env, rewards.environmental, static)
        self._state = jax.jit(algorithm.init)(jax.random.key(0), hyper)
        self._advance = jax.jit(
            lambda state: training.chunk(algorithm, state, hyper, None, updates=updates)[:2],
            donate_argnums=0,
        )

    def advance(self) -> None:
        """Learns for `steps` control steps."""
        self._state, metrics = self._advance(self._state)
        metrics = jax.device_get(metrics)
        for mean, episodes in zip(metrics["success"], metrics["episodes"], strict=True):
            self._recent.extend([float(mean)] * int(episodes))


class HostLoop(_Learner):
    """One environment, stepped from Python, with the replay in NumPy."""

    def __init__(self, env: Env, static: sac.Static, hyper: sac.Hyper, steps: int = 320):
        super().__init__(steps)
        self._static = static
        algorithm = sac.SAC(env, rewards.environmental, static)
        size = algorithm.observation_size
        self._every = max(1, static.num_envs * static.unroll_length // static.updates_per_step)
        self._random, self._key = np.random.default_rng(0), jax.random.key(0)
        shape = {"observation": (size,), "action": (env.action_size,), "next_observation": (size,)}
        shape |= dict.fromkeys(("discount", "dropped", "reward"), ())
        rows = static.replay_size
        self._replay = {name: np.zeros((rows, *x), np.float32) for name, x in shape.items()}
        self._count, self._action_size = 0, env.action_size
        self._learned = sac_loss.begin(algorithm.networks, jax.random.key(1), hyper)
        self._normalizer = policy.fresh_normalizer(size)
        self._reset = jax.jit(algorithm.episodes.begin)
        self._observe = jax.jit(algorithm.episodes.observe)
        self._act = jax.jit(algorithm.act)

        @jax.jit
        def step(episode, action):
            episode, outcome = algorithm.episodes.advance(None, episode, action, tau=hyper.tau)
            return episode, algorithm.episodes.observe(episode), outcome

        @functools.partial(jax.jit, donate_argnums=(0, 1))
        def learn(learned, normalizer, seen, rows, key):
            normalizer = policy.observed(normalizer, seen)
            dropped = {"policy_extras": {}, "state_extras": {"truncation": rows.pop("dropped")}}
            batch = Transition(extras=dropped, **rows)
            given = algorithm.networks, learned, normalizer, batch, key, hyper
            return sac_loss.gradient_step(*given)[0], normalizer

        self._step, self._learn = step, learn
        self._episode = self._reset(self._next_key())
        self._seen = np.asarray(self._observe(self._episode))

    def _next_key(self) -> Any:
        self._key, key = jax.random.split(self._key)
        return key

    def advance(self) -> None:
        """Learns for `steps` control steps."""
        for _ in range(self.steps):
            self._one_step()
            if self._count % self._every == 0 and self._count >= self._static.min_replay:
                self._one_gradient_step()
        jax.block_until_ready(self._learned)

    def _one_step(self) -> None:
        if self._count < self._static.min_replay:
            action = self._random.uniform(-1, 1, self._action_size).astype(np.float32)
        else:
            acting = policy.Policy(self._normalizer, self._learned.params.policy)
            action = np.asarray(self._act(acting, self._episode, self._next_key()))
        self._episode, seen, outcome = self._step(self._episode, action)
        seen, outcome = jax.device_get((seen, outcome))
        row = {
            "observation": self._seen, "action": action, "next_observation": seen,
            "discount": 1 - outcome.terminated, "dropped": outcome.nonfinite,
            "reward": outcome.reward,
        }  # fmt: skip
        for name, value in row.items():
            self._replay[name][self._count % self._static.replay_size] = value
        self._count, self._seen = self._count + 1, seen
        if outcome.terminated + outcome.truncated > 0:
            self._recent.append(float(outcome.metrics["success"]))
            self._episode = self._reset(self._next_key())
            self._seen = np.asarray(self._observe(self._episode))

    def _one_gradient_step(self) -> None:
        stored = min(self._count, self._static.replay_size)
        drawn = self._random.integers(stored, size=self._static.batch_size)
        latest = np.arange(self._count - self._every, self._count) % self._static.replay_size
        rows = {name: jnp.asarray(values[drawn]) for name, values in self._replay.items()}
        self._learned, self._normalizer = self._learn(
            self._learned, self._normalizer, self._replay["observation"][latest], rows,
            self._next_key(),
        )  # fmt: skip
