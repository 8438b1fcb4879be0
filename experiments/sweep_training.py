"""The second half of a sweep: the policies of all rows, many in one program.

Rows that compile to the same program are trained side by side by `jax.vmap`; what differs between
them are arrays.
"""

import itertools
import shutil
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from gril_jax import checkpoint, device_memory, hosts, training_loop
from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.progress import Progress
from gril_jax.rl import memory, sharding, training
from gril_jax.run_dir import RunDir

from . import policy_rewards, policy_setup, setup, sweep_rows
from .sweep_rewards import LearnedReward, reward_key
from .sweep_rows import Row

__all__ = ["Program", "learn_policies", "programs"]


class Program(NamedTuple):
    """Rows that are trained together."""

    name: str
    rows: list[Row]
    algorithm: training.Algorithm
    tasks: Mapping[str, Any]  # to evaluate in, by where they start; the first is the main one
    updates: int


def programs(
    rows: Sequence[Row], num_classes: int, devices: Sequence[Any], *, starts: Sequence[str] = ()
) -> list[Program]:
    """The rows by what they compile, in parts that fit into the devices' memory.

    Args:
      rows: the policies.
      num_classes: of the task's objects.
      devices: to train on.
      starts: variants of the task to evaluate in; its own alone where there is none.

    Raises:
      ConfigError: one seed does not fit, the devices cannot share a part evenly, or the
        environments cannot be shared out between the evaluations.
    """
    groups: dict[Hashable, list[Row]] = {}
    made: dict[Hashable, training.Algorithm] = {}
    for row in rows:
        chosen = policy_setup.policy_config(row.config)
        algorithm = policy_setup.make_algorithm(
            row.config, setup.make_env(row.config.env, training=True)
        )
        encoder = setup.encoder_config(row.config, num_classes)
        kind = (row.config.run.reward, row.config.run.evaluations, chosen.num_timesteps)
        key = (row.config.env, algorithm.static, encoder, kind)
        if not _examinations(len(starts) or 1, algorithm.num_envs):
            raise ConfigError(
                f"{row.config.run.algorithm}.num_envs is {algorithm.num_envs}, but must be "
                + (f"a multiple of {2 * len(starts)}" if len(starts) > 1 else "even")
                + ": in the evaluations of a sweep half of the environments play mean actions"
            )
        made.setdefault(key, algorithm)
        groups.setdefault(key, []).append(row)
    found: list[Program] = []
    for key, members in groups.items():
        algorithm, config = made[key], members[0].config
        params = policy_rewards.blank(config, algorithm.episodes.env)
        needed = memory.predict_bytes(algorithm, policy_setup.algorithm_hyper(config), params)
        each = memory.split(len(members), needed, _available_bytes(), len(devices))
        per_update = algorithm.num_envs * algorithm.unroll_length
        updates = -(-policy_setup.policy_config(config).num_timesteps // per_update)
        tasks = {
            variant: setup.make_env(config.env, training=False, variant=variant)
            for variant in starts or (config.env.variant,)
        }
        for start in range(0, len(members), each):
            part = members[start : start + each]
            sharding.mesh(devices, seeds=len(part), num_envs=algorithm.num_envs)
            found.append(Program(f"policy-{len(found)}", part, algorithm, tasks, updates))
    return found


def _examinations(starts: int, num_envs: int) -> int:
    """In how many parts the environments are examined, at least one for each kind of start.

    Each part is halved, for mean actions and samples; 0 if no number below twice the starts fits.
    """
    fitting = (n for n in range(starts, 2 * starts) if num_envs % (2 * n) == 0)
    return next(fitting, 0)


def _available_bytes() -> int | None:
    """Memory of the device that has least, in whichever process."""
    found = [device_memory.available_bytes(device) for device in jax.local_devices()]
    known = [x >> 20 for x in found if x is not None]  # MiB, so that they are small numbers
    if len(known) < len(found):
        return None
    (least,) = hosts.largest([-min(known)])
    return -least << 20


def learn_policies(
    program: Program,
    rewards: dict[Hashable, LearnedReward],
    run: RunDir,
    progress: Progress,
    echo: Callable[[str], None],
    devices: Sequence[Any],
) -> dict[str, Any]:
    """Train a program's policies; their scores while they learn are rows of metrics.jsonl.

    In these `success` is with mean actions in the first of the tasks, `success_sampled` with
    samples, and `success_layout` and `success_layout_sampled` are the same in the task "layout".
    """
    rows, algorithm = program.rows, program.algorithm
    configs = [row.config for row in rows]
    layout = sharding.mesh(devices, seeds=len(rows), num_envs=algorithm.num_envs)
    hyper = sweep_rows.stack([policy_setup.algorithm_hyper(config) for config in configs])
    # Each process has learned rewards; rounding may have driven them apart.
    params = hosts.same_everywhere(
        sweep_rows.stack([_policy_reward(config, rewards) for config in configs])
    )
    hyper, params = sharding.place(layout, hyper), sharding.place(layout, params)
    keys = sweep_rows.keys([config.run.seed for config in configs], 1)
    fresh = sharding.init(algorithm, layout, keys, hyper)
    begun = training_loop.restore(run, program.name, fresh, tell=echo)
    # A chunk is an evaluation with the updates before it, of which there are about as many in each.
    chunks = max(1, min(configs[0].run.evaluations, program.updates))
    done_by = [program.updates * k // chunks for k in range(chunks + 1)]
    most = -(-program.updates // chunks)
    parts = _examinations(len(program.tasks), algorithm.num_envs)
    where = [*program.tasks, *[[*program.tasks][-1]] * (parts - len(program.tasks))]
    tasks = tuple(program.tasks[name] for name in where)
    advance = sharding.advance(algorithm, layout, fresh, most, tasks)
    per_update = algorithm.num_envs * algorithm.unroll_length
    phase = progress.phase(
        f"learning {len(rows)} policies",
        total=program.updates * per_update * len(rows),
        unit="env steps",
    )

    def row(chunk, seconds, metrics):
        _, scores = metrics
        steps = done_by[chunk] * per_update
        phase.update(steps * len(rows), success=float(scores.success[..., 1].mean()))
        found = {"env_steps": steps, "env_steps_per_s": steps * len(rows) / seconds}
        return found | _by_start(where, scores)

    numbers = itertools.count(begun.chunks)

    def step(state):
        number = next(numbers)
        count = jnp.int32(done_by[number + 1] - done_by[number])
        return advance(state, hyper, params, count, jnp.asarray(True))

    done = training_loop.run_chunks(
        step,
        begun,
        run=run,
        name=program.name,
        chunks=chunks,
        row=row,
        every_s=configs[0].run.checkpoint_every,
        keep=configs[0].run.keep_checkpoints,
    )
    folder = run.path / "policies" / program.name
    shutil.rmtree(folder, ignore_errors=True)  # of a process that was cut off here
    checkpoint.save(
        folder, program.updates * per_update, hosts.gathered(algorithm.policy(done.state))
    )
    return {
        "rows": [(row.cell, row.seed) for row in rows],
        "taus": [_tau(config, rewards) for config in configs],
        "seconds": done.seconds,
    }


def _by_start(where: Sequence[str], scores: training.Scores) -> dict[str, Any]:
    """The scores of each policy by their names in metrics.jsonl, from (policies, parts, 2)."""
    found = {}
    for start in dict.fromkeys(where):
        parts = [i for i, name in enumerate(where) if name == start]
        suffix = "" if start == where[0] else f"_{start}"
        for name, values in scores._asdict().items():
            mean, sampled = values[:, parts].mean(axis=1).T
            found[f"{name}{suffix}"], found[f"{name}{suffix}_sampled"] = mean, sampled
    return found


def _policy_reward(config: RunConfig, rewards: dict[Hashable, LearnedReward]) -> Any:
    if config.run.reward == "environmental":
        return ()
    found = rewards[reward_key(config)]
    return policy_rewards.parameters(config, found.params, found.demos, found.num_classes)


def _tau(config: RunConfig, rewards: dict[Hashable, LearnedReward]) -> float | None:
    return None if config.run.reward == "environmental" else rewards[reward_key(config)].tau
