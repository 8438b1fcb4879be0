"""Policies in Python: trained on a learned reward, evaluated, recorded, saved and loaded."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.config.grid import with_seed
from gril_jax.config.tables import REWARDS
from gril_jax.demos.demo_set import DemoSet
from gril_jax.envs import Env
from gril_jax.errors import ConfigError
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.runs.memory import MemoryRun
from gril_jax.runs.progress import Progress
from gril_jax.types import checked
from gril_jax.workflows import export_reward
from gril_jax.workflows.build import demonstrations, policy_rewards, policy_setup, setup
from gril_jax.workflows.learning import diverged, encoders, policies

from . import settings
from .trained_policy import Rates, TrainedPolicy


@checked
def train_policy(
    task: Any,
    reward: LearnedReward | Sequence[LearnedReward] | None = None,
    *,
    preset: str | None = None,
    demos: DemoSet | None = None,
    seeds: int = 1,
    seed: int = 0,
    progress: bool = True,
    **options: Any,
) -> TrainedPolicy:
    """Trains policies for a task: rollout, reward and update in one compiled step, seeds by vmap.

    Args:
      task: by name, with all settings of its preset; or an object from `make` or of your own,
        with `reset`, `step` and boxes of its objects. Training takes an object as it is.
      reward: a learned reward, or one for each seed; None takes the task's own.
      preset: a shipped configuration or the path of a YAML file; by default that of the task.
      demos: the demonstrations, where training resets to their states or the reward has stages.
        With them, a policy for a task of your own has a network for each stage, and no file.
      seeds: policies to train side by side, from `seed` on.
      progress: show a progress line on stderr.
      options: sections of the configuration with the fields to change:
        `ppo={"num_timesteps": 2_000_000}`. A task of your own trains on until evaluations no longer
        improve; `run={"max_steps": None}` ends it there.

    Raises:
      ConfigError: an option is unknown or out of range, or the reward does not fit the task.
      RunError: a reward is not finite, or a policy diverged.

    Example:
      policy = train_policy("match_regions", reward, seeds=5)
      print(policy.evaluate(episodes=256))
    """
    config = settings.for_task(task, preset, options, seed, demos)
    if demos is None and "reward" not in options.get("run", {}) and config.run.reward == "stages":
        config = settings.changed(config, {"run": {"reward": "learned"}}, seed)
    rewards = _of_seeds(reward, seeds)
    if rewards[0] is None:
        config = settings.changed(config, {"run": {"reward": "environmental"}}, seed)
    env = setup.make_env(config.env, training=False)
    if rewards[0] is not None:
        config = _with_rewards(config, rewards, env)
    chosen = _shown(config, env, demos)
    shown_batch = None if chosen is None else chosen.batch("train")
    configs = [with_seed(config, number) for number in range(seeds)]
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    plan = policies.plan_of(config, algorithm)
    tasks = policies.tasks_to_evaluate(config, algorithm)
    with (
        ahead.compiling() as pool,
        MemoryRun() as run,
        Progress(shown=progress) as shown,
    ):
        ready = pool.submit(policies.compiled_for, configs, algorithm, jax.devices(), tasks, plan)
        params = encoders.stack(
            [
                policy_rewards.parameters(config, one and one.params, shown_batch, len(env.classes))
                for one in rewards
            ]
        )
        what = "learning the policy" if seeds == 1 else f"learning {seeds} policies"
        total = plan.updates * plan.steps * seeds
        early = plan.least is not None
        phase = shown.phase(what, total=total, unit="env steps", at_most=early)
        program = ready.result()  # the phase shows that it compiles

        def row(done: int, found: Any) -> dict[str, Any]:
            line = policies.metrics_of(plan, done, found)
            steps = plan.done(done) * plan.steps * seeds
            success, value = (float(np.mean(line[name])) for name in ("success", "reward"))
            phase.update(steps, **{"success in training": success}, reward=value)
            return line

        trained = policies.train(
            program, params, plan, configs, name=config.run.algorithm, run=run, echo=print, row=row,
            tick=lambda steps: phase.update(steps * seeds),
        )  # fmt: skip
        diverged.require_all(trained.diverged, config.run.seed)
        curves = _curves(run.metrics())
    policy = jax.device_get(trained.policy)
    return TrainedPolicy(config, env, algorithm, policy, params, curves)


@checked
def evaluate(
    policy: TrainedPolicy,
    task: Any = None,
    *,
    episodes: int = 256,
    seed: int = 0,
) -> Rates:
    """The success of a policy over distinct initial states.

    Args:
      policy: of `train_policy` or `load_policy`.
      task: another variant of its task, from `make`; None is the task that it was trained in.
      episodes: initial states to sample.
      seed: of the episodes.

    Example:
      print(evaluate(policy, make("match_regions", variant="layout")))
    """
    return policy.evaluate(episodes=episodes, seed=seed, task=task)


@checked
def load_policy(path: str | os.PathLike) -> TrainedPolicy:
    """The policy of a run's folder, or in a file of `TrainedPolicy.save` or `gril export`.

    Raises:
      PolicyFileError: the file is missing, damaged or of another task than it says.
      RunError: the folder holds no run with a policy, or a damaged one.

    Example:
      load_policy("policy.npz").evaluate(episodes=256)
      actor = load_policy("runs/kitchen").actor()
    """
    path = Path(path)
    return TrainedPolicy.of_run(path) if path.is_dir() else TrainedPolicy.load(path)


def _of_seeds(
    reward: LearnedReward | Sequence[LearnedReward] | None, seeds: int
) -> list[LearnedReward | None]:
    """The reward of each seed."""
    if seeds < 1:
        raise ConfigError(f"seeds is {seeds}, but must be at least 1")
    if reward is None or isinstance(reward, LearnedReward):
        return [reward] * seeds
    if len(reward) != seeds:
        raise ConfigError(f"there are {len(reward)} rewards for {seeds} seeds: give one for each")
    return list(reward)


def _with_rewards(config: RunConfig, rewards: Sequence[LearnedReward], env: Env) -> RunConfig:
    """The configuration with the encoder and the activity rule that all rewards share."""
    many = len({id(one) for one in rewards}) > 1
    for number, one in enumerate(rewards):
        source = f"the reward of seed {number}" if many else "the reward"
        found = export_reward.configured(config, one, env, source)
        if number and found != config:
            raise ConfigError(
                f"{source} has another encoder or activity rule than that of seed 0, but one "
                "program trains all seeds"
            )
        config = found
    return config


def _shown(
    config: RunConfig, env: Env, demos: DemoSet | None
) -> demonstrations.Demonstrations | None:
    """The demonstrations that training needs beside the reward."""
    if demos is not None:
        return demonstrations.of_set(config, env, demos)
    if REWARDS[config.run.reward_form].staged or policy_rewards.begins_at_frames(config):
        raise ConfigError(
            f"run.reward {config.run.reward!r} or resets to video states need the demonstrations: "
            "train_policy(..., demos=...)"
        )
    return None


def _curves(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Each logged quantity against `env_steps` (E,): arrays (S, E); evaluations are NaN between."""
    names = dict.fromkeys(name for row in rows for name in row if name not in ("phase",))
    width = max(np.size(row["success"]) for row in rows)
    found = {}
    for name in names:
        values = [np.broadcast_to(row.get(name, np.nan), width).astype(float) for row in rows]
        found[name] = np.stack(values, axis=1)
    return {name: x[0] if name in ("env_steps", "seconds") else x for name, x in found.items()}
