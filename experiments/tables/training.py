"""The policies of a table's rows, many in one program."""

import itertools
import shutil
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
from gril_jax.experiments.pipeline import policy_rewards

from gril_jax.compilation import sharding
from gril_jax.config import RunConfig
from gril_jax.rl import training
from gril_jax.runs import hosts, loop
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.runs.progress import Progress
from gril_jax.runs.run_dir import RunDir

from .programs import Program, Ready, arguments, tasks_of_parts, updates_of_chunks
from .rewards import LearnedReward, learns, reward_key, stack


def learn_policies(
    program: Program,
    ready: Ready,
    rewards: Mapping[Hashable, LearnedReward],
    run: RunDir,
    progress: Progress,
    echo: Callable[[str], None],
) -> dict[str, Any]:
    """Trains a program's policies; their scores during training are rows of metrics.jsonl.

    In these `success` is with deterministic actions in the first of the tasks, `success_sampled`
    with sampled ones, and `success_layout` and `success_layout_sampled` are the same in the task
    "layout".
    """
    rows, algorithm = program.rows, program.algorithm
    configs = [row.config for row in rows]
    hyper, keys = arguments(program, ready.layout)
    # Each process has learned rewards; rounding may have driven them apart.
    params = hosts.same_everywhere(stack([_policy_reward(config, rewards) for config in configs]))
    params = sharding.place(ready.layout, params)
    begun = loop.restore(run, program.name, ready.init(keys, hyper), tell=echo)
    updates, where = updates_of_chunks(program), tasks_of_parts(program)
    done_by = [0, *itertools.accumulate(updates)]
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

    counts = itertools.islice(updates, begun.chunks, None)

    def step(state):
        return ready.advance(state, hyper, params, jnp.int32(next(counts)), jnp.asarray(True))

    done = loop.run_chunks(
        step, begun, run=run, name=program.name, chunks=len(updates), row=row,
        every_s=configs[0].run.checkpoint_every, keep=configs[0].run.keep_checkpoints,
    )  # fmt: skip
    folder = run.path / "policies" / program.name
    shutil.rmtree(folder, ignore_errors=True)  # of a process that was cut off here
    checkpoint.save(
        folder, program.updates * per_update, hosts.gathered(algorithm.policy(done.state))
    )
    return {
        "rows": [(row.cell, row.seed) for row in rows],
        "taus": [rewards[reward_key(one)].tau if learns(one) else None for one in configs],
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


def _policy_reward(config: RunConfig, rewards: Mapping[Hashable, LearnedReward]) -> Any:
    if not learns(config):
        return ()
    found = rewards[reward_key(config)]
    return policy_rewards.parameters(config, found.params, found.demos, found.num_classes)
