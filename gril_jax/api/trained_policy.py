"""Trained policies of one or several seeds, with their curves."""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax.config import EnvConfig, RunConfig
from gril_jax.demos.vision import video
from gril_jax.envs import Env
from gril_jax.export import policy_file
from gril_jax.report import rates
from gril_jax.rl.policy import MAX_OBSERVATION, Policy
from gril_jax.rl.training import Algorithm
from gril_jax.runs import run_dir
from gril_jax.workflows import evaluate as evaluation
from gril_jax.workflows.build import filming, policy_rewards, policy_setup, setup

from . import inputs
from .actor import Actor


@dataclasses.dataclass(frozen=True)
class Rates:
    """Success rates, each an array of one number a policy, (S,)."""

    found: Sequence[Mapping[str, Any]]
    """Of each policy, what `gril eval` writes, by name."""

    @property
    def success(self) -> Float[np.ndarray, "S"]:
        """Success at the end of the episode, deterministic actions."""
        return np.array([one["success"] for one in self.found])

    @property
    def success_sampled(self) -> Float[np.ndarray, "S"]:
        """The same with sampled actions."""
        return np.array([one["success_sampled"] for one in self.found])

    def __str__(self) -> str:
        lines = rates.sentences(self.found[0])
        if len(self.found) == 1:
            return "\n".join(lines)
        each = ", ".join(f"{100 * x:.1f}" for x in self.success)
        first = self.found[0]
        kind = f"{first['variant'].capitalize()} start".strip()
        return (
            f"success with deterministic actions: {100 * self.success.mean():.1f}% of "
            f"{first['starts']} {kind}s, mean of {len(self.found)} policies ({each})"
        )


@dataclasses.dataclass(frozen=True, eq=False)
class TrainedPolicy:
    """Policies of S seeds for one task; `policy[i]` is one of them.

    `curves` holds what was logged while they were trained: `env_steps` (E,), and by name arrays
    (S, E) such as `success`, `reward` and, NaN between evaluations, `eval/success`.
    """

    config: RunConfig
    task: Env
    algorithm: Algorithm
    parameters: Policy
    """Leaves (S, ...)."""
    reward_parameters: Any
    """Of the policy's reward, leaves (S, ...)."""
    curves: Mapping[str, np.ndarray]
    _evaluated: dict[EnvConfig, Algorithm] = dataclasses.field(default_factory=dict)
    """Algorithms of the tasks that policies were evaluated in, whose programs serve again."""

    def __len__(self) -> int:
        return jax.tree.leaves(self.parameters)[0].shape[0]

    def __getitem__(self, index: int) -> "TrainedPolicy":
        if not -len(self) <= index < len(self):
            raise IndexError(f"there are {len(self)} policies, but none at {index}")
        chosen = slice(index, index + 1 or None)
        curves = {n: x if x.ndim == 1 else x[chosen] for n, x in self.curves.items()}
        parts = (
            jax.tree.map(lambda x: x[chosen], tree)
            for tree in (self.parameters, self.reward_parameters)
        )
        params, reward = parts
        return dataclasses.replace(self, parameters=params, reward_parameters=reward, curves=curves)

    def __repr__(self) -> str:
        name = self.config.env.shown_name
        return f"<{len(self)} {self.config.run.algorithm.upper()} policies for {name}>"

    def evaluate(self, episodes: int = 256, *, seed: int = 0, task: Any = None) -> Rates:
        """The success of each policy over distinct initial states; see `gril_jax.evaluate`."""
        played = [self._played(one, episodes, seed, task) for one in range(len(self))]
        return Rates([rates_ for rates_, _ in played])

    def film(self, path: str | os.PathLike, *, episodes: int = 16, seed: int = 0) -> None:
        """Writes a video of the best policy: its first success among some episodes, if any."""
        best = self.best
        _, means = self._played(best, episodes, seed, None)
        success = np.asarray(means.success)[:episodes]
        shown = int(np.argmax(success))
        frames = filming.episode(self.task, jax.tree.map(lambda x: x[shown], means.states))
        reward = _at(self.reward_parameters, best)
        words = policy_rewards.stages_in_words(reward, means.remembered[shown])
        frames = filming.with_captions(frames, words)
        video.write_video(Path(path), frames, self.task.control_hz)

    def actor(self) -> Actor:
        """The best policy as pure functions that act in any loop; see `gril_jax.api.actor`."""
        at, env = self.best, self.task
        start = jax.jit(env.reset)(jax.random.key(0))
        params, reward = (_at(x, at) for x in (self.parameters, self.reward_parameters))
        tau, size = self.config.pool.tau, len(start.obs)
        return Actor(self.algorithm, params, reward, start.objects, size, tau)

    @property
    def best(self) -> int:
        """The policy with the highest success at the end of training."""
        scores = self.curves.get("eval/success", self.curves.get("success"))
        if scores is None:
            return 0
        known = [row[np.isfinite(row)] for row in scores]
        return int(np.argmax([row[-1] if len(row) else -1.0 for row in known]))

    def save(self, path: str | os.PathLike) -> None:
        """Writes the best policy to a new file, which `gril_jax.load_policy` reads, and a program
        with NumPy alone by `gril_jax.export.read_policy`.

        Raises:
          ConfigError: the policy is more than one plain network.
          RunError: it is not finite, or the file exists or cannot be written.
        """
        policy = _at(self.parameters, self.best)
        policy_file.save(Path(path), self.config, self.algorithm, policy)

    @classmethod
    def of_run(cls, folder: Path) -> "TrainedPolicy":
        """See `gril_jax.load_policy`."""
        config = run_dir.read_config(folder)
        env = setup.make_env(config.env, training=False)
        algorithm = policy_setup.make_algorithm(config, env)
        policy = policy_setup.restore_policy(folder, config, algorithm)
        reward = policy_setup.policy_reward(folder, config, env)
        policy, reward = (jax.tree.map(lambda x: x[None], tree) for tree in (policy, reward))
        return cls(config, env, algorithm, policy, reward, {})

    @classmethod
    def load(cls, path: Path) -> "TrainedPolicy":
        """See `gril_jax.load_policy`."""
        about, arrays = policy_file.load(path)
        hidden = tuple(layer["out"] for layer in about["layers"][:-1])
        config = RunConfig()
        config = dataclasses.replace(
            config,
            env=policy_file.env_of(about, path),
            pool=policy_file.pool_of(about["activity"]),
            ppo=dataclasses.replace(
                config.ppo, hidden=hidden, observe_activity=about["activity"] is not None
            ),
            run=dataclasses.replace(config.run, reward="environmental", algorithm="ppo"),
        )
        env = setup.make_env(config.env, training=False)
        algorithm = policy_setup.make_algorithm(config, env)
        blank = policy_setup.fresh_policy(config, algorithm, jax.random.key(0))
        policy = _restored(blank, arrays)
        shapes = [[np.shape(leaf) for leaf in jax.tree.leaves(x)] for x in (blank, policy)]
        if shapes[0] != shapes[1]:
            raise policy_file.PolicyFileError(
                f"{path}: the policy is of another task than {config.env.shown_name}, which has "
                f"{env.observation_size} observations and {env.action_size} actions"
            )
        return cls(config, env, algorithm, jax.tree.map(lambda x: x[None], policy), (), {})

    def _played(self, index: int, episodes: int, seed: int, task: Any):
        """The rates of one policy and its episodes with deterministic actions."""
        config = self.config
        if task is not None:
            config = dataclasses.replace(config, env=inputs.env_config(task, config.env))
        if config.env not in self._evaluated:
            env = setup.make_env(config.env, training=False)
            self._evaluated[config.env] = policy_setup.make_algorithm(config, env)
        params, reward = (_at(x, index) for x in (self.parameters, self.reward_parameters))
        return evaluation.rates_of(
            config, jax.device_put(params), reward, episodes=episodes, seed=seed,
            algorithm=self._evaluated[config.env],
        )  # fmt: skip


def _at(tree: Any, index: int) -> Any:
    return jax.tree.map(lambda x: x[index], tree)


def _restored(blank: Policy, arrays: Mapping[str, np.ndarray]) -> Policy:
    """A policy with a file's arrays, in which the division by the deviation is folded."""
    deviation = arrays["observation_limit"] / MAX_OBSERVATION
    layers = {
        f"hidden_{i}": {"kernel": arrays[f"kernel_{i}"], "bias": arrays[f"bias_{i}"]}
        for i in range(len(blank.params["params"]))
    }
    first = layers["hidden_0"]
    layers["hidden_0"] = first | {"kernel": first["kernel"] * deviation[:, None]}
    normalizer = blank.normalizer.replace(
        mean=jnp.asarray(arrays["observation_mean"]), std=jnp.asarray(deviation)
    )
    return Policy(normalizer, jax.tree.map(jnp.asarray, {"params": layers}))
