"""The policies of a study's rows: those that compile to the same program train side by side."""

import dataclasses
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, NamedTuple

import jax

from gril_jax.compilation import memory, sharding
from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, RunError
from gril_jax.rl import training
from gril_jax.runs import hosts
from gril_jax.runs.memory import Run
from gril_jax.runs.progress import Progress
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import policy_rewards, policy_setup, setup
from gril_jax.workflows.build.starts import distinct, evaluated_from
from gril_jax.workflows.learning import policies
from gril_jax.workflows.learning.encoders import stack

from .rewards import TrainedReward, reward_key
from .saved import Row, learns


class Counted(NamedTuple):
    """Episodes of one kind of actions in an evaluation, and how many of their starts differ."""

    episodes: int
    distinct: int


class Program(NamedTuple):
    """Rows that are trained together."""

    name: str
    rows: list[Row]
    algorithm: training.Algorithm
    tasks: Mapping[str, Any]  # to evaluate in, by where they start; the first is the main one
    plan: policies.Plan


def programs(
    rows: Sequence[Row],
    num_classes: int,
    devices: Sequence[Any],
    *,
    starts: Sequence[str] = (),
    at_once: int | None = None,
) -> list[Program]:
    """The rows grouped by the program that they compile, in parts that fit into device memory.

    They are evaluated from the variant that has many starts unless `starts` names others; a program
    has at most `at_once` policies, or as many as fit. Raises ConfigError if one does not fit, or if
    devices or environments cannot be shared out.
    """
    groups: dict[Hashable, tuple[training.Algorithm, list[Row]]] = {}
    for row in rows:
        algorithm = policy_setup.make_algorithm(
            row.config, setup.make_env(row.config.env, training=True)
        )
        run, steps = row.config.run, policy_setup.policy_config(row.config).num_timesteps
        kind = (run.reward, run.reward_offset, run.evaluations, steps)
        form = setup.reward_form(row.config, num_classes)
        if not _num_parts(len(starts) or 1, algorithm.num_envs):
            raise ConfigError(
                f"{run.algorithm}.num_envs is {algorithm.num_envs}, but must be "
                + (f"a multiple of {2 * len(starts)}" if len(starts) > 1 else "even")
                + ": half of the environments play deterministic actions in evaluations"
            )
        key = (row.config.env, algorithm.static, form, kind)
        groups.setdefault(key, (algorithm, []))[1].append(row)
    found: list[Program] = []
    for algorithm, members in groups.values():
        config = members[0].config
        params = policy_rewards.blank(config, algorithm.episodes.env)
        needed = memory.predict_bytes(algorithm, policy_setup.algorithm_hyper(config), params)
        available, margin = _available_bytes(), memory.margin()
        each = memory.split(len(members), needed, available, len(devices), margin)
        if config.env.engine == "warp":  # it has room for the contacts of so many environments
            each = min(each, config.env.max_envs // algorithm.num_envs)
        plan = _plan(config, algorithm)
        tasks = {
            variant: setup.make_env(config.env, training=False, variant=variant or None)
            for variant in starts or (evaluated_from(config.env).many or "",)
        }
        for start in range(0, len(members), each):
            for part in _evenly(members[start : start + each], at_once):
                sharding.mesh(devices, seeds=len(part), num_envs=algorithm.num_envs)
                found.append(Program(f"policy-{len(found)}", part, algorithm, tasks, plan))
    return found


def _evenly(rows: list[Row], most: int | None) -> list[list[Row]]:
    """The rows in as few parts as can be, each with at most so many."""
    parts = -(-len(rows) // most) if most else 1
    each = -(-len(rows) // parts)
    return [rows[start : start + each] for start in range(0, len(rows), each)]


def _num_parts(starts: int, num_envs: int) -> int:
    """Number of parts of the environments in an evaluation, at least one for each kind of start.

    Each is halved, for deterministic and sampled actions; 0 if nothing below twice the starts fits.
    """
    fitting = (n for n in range(starts, 2 * starts) if num_envs % (2 * n) == 0)
    return next(fitting, 0)


def _available_bytes() -> int | None:
    """Memory of the device that has least, over all processes."""
    found = [memory.available_bytes(device) for device in jax.local_devices()]
    known = [x >> 20 for x in found if x is not None]  # MiB, so that they are small numbers
    if len(known) < len(found):
        return None
    (least,) = hosts.largest([-min(known)])
    return -least << 20


def get_ready(
    left: Sequence[Program], devices: Sequence[Any], pool: Executor
) -> dict[str, Future[policies.Compiled]]:
    """Starts to compile programs in a pool, in their order; returns them by name."""
    return {program.name: pool.submit(_compiled, program, devices) for program in left}


def _compiled(program: Program, devices: Sequence[Any]) -> policies.Compiled:
    configs = [row.config for row in program.rows]
    tasks = [program.tasks[name] for name in _tasks_of_parts(program)]
    return policies.compiled_for(configs, program.algorithm, devices, tasks, program.plan)


def _plan(config: RunConfig, algorithm: training.Algorithm) -> policies.Plan:
    """The plan of a training that has all evaluations, and at least the last one; the same length
    for all policies, which are compared."""
    fixed = dataclasses.replace(config, run=dataclasses.replace(config.run, max_steps=None))
    plan = policies.plan_of(fixed, algorithm)
    evaluations = max(1, min(plan.evaluations, plan.updates))
    most = min(plan.per_chunk, plan.updates // evaluations)
    return plan._replace(evaluations=evaluations, per_chunk=most)


def _tasks_of_parts(program: Program) -> list[str]:
    """The task of each part of the environments in an evaluation."""
    parts = _num_parts(len(program.tasks), program.algorithm.num_envs)
    names = [*program.tasks]
    more = names[:2][-1:] * (parts - len(names))  # of `Starts` the one with many
    return [*names[:2], *more, *names[2:]]


def starts(program: Program) -> dict[str, Counted]:
    """The starts of an evaluation with either kind of actions, by variant."""
    where = _tasks_of_parts(program)
    share, config = program.algorithm.num_envs // (2 * len(where)), program.rows[0].config.env
    found = {}
    for variant in program.tasks:
        count = share * where.count(variant)
        found[variant] = Counted(count, distinct(config, variant or None, count))
    return found


def _rewards_of(
    configs: Sequence[RunConfig], rewards: Mapping[Hashable, TrainedReward]
) -> tuple[list[TrainedReward | None], dict[int, str]]:
    """The reward of each configuration, None of one that learns none, and by its place what is
    wrong with one. In the place of one that was not learned is another's: its policy is lost, and
    the others are trained in the same program."""
    found = [rewards.get(reward_key(one)) if learns(one) else None for one in configs]
    wrong = {i: one.diverged for i, one in enumerate(found) if one and one.diverged}
    missing = [i for i, one in enumerate(found) if one is None and learns(configs[i])]
    if missing and not any(found):
        raise RunError("none of its rewards could be learned")
    for i in missing:
        found[i] = next(one for one in found if one)
        wrong[i] = "its reward could not be learned"
    return found, wrong


def learn_policies(
    program: Program,
    ready: Future[policies.Compiled],
    rewards: Mapping[Hashable, TrainedReward],
    demos: Callable[[RunConfig], DemoBatch],
    run: Run,
    progress: Progress,
    echo: Callable[[str], None],
) -> tuple[dict[str, Any], list[Path]]:
    """Trains a program's policies: results and files of its phase of the run.

    `demos` are the demonstrations of a configuration, for training that begins at their frames.
    Scores during training are rows of the run's metrics. `success` is with deterministic actions
    in the first of the tasks, `success_sampled` with sampled ones. `success_layout` and
    `success_layout_sampled` are those in "layout".
    """
    rows = program.rows
    configs = [row.config for row in rows]
    learned, wrong = _rewards_of(configs, rewards)
    each = [_parameters(one, found, demos) for one, found in zip(configs, learned, strict=True)]
    for said in dict.fromkeys(map(policy_rewards.stages_note, configs, each)):
        if said:
            echo(said)
    plan, where = program.plan, _tasks_of_parts(program)
    total = plan.updates * plan.steps * len(rows)
    phase = progress.phase(f"learning {len(rows)} policies", total=total, unit="env steps")
    compiled = ready.result()  # the phase shows that it compiles
    # Each process has learned rewards; rounding may have driven them apart.
    params = hosts.same_everywhere(stack(each))

    def row(done: int, found: Any) -> dict[str, Any]:
        scores, steps = found[1], plan.done(done) * plan.steps * len(rows)
        if not plan.examines(done - 1):
            phase.update(steps)
            return {}
        sampled = float(scores.success[:, 0, 1].mean())
        phase.update(steps, **{"success in evaluations, sampled": sampled})
        return _by_start(where, scores)

    done = policies.train(
        compiled, params, plan, configs, name=program.name, run=run, echo=echo, row=row,
        tick=lambda steps: phase.update(steps * len(rows)),
        wrong=wrong,
    )  # fmt: skip
    trained = hosts.gathered(done.policy)
    saved = run.save_part(f"policies/{program.name}", done.env_steps, trained)
    results = {
        "rows": [(row.cell, row.seed) for row in rows],
        "taus": [found and found.tau for found in learned],
        "starts": {variant: found._asdict() for variant, found in starts(program).items()},
    }
    if done.diverged:  # by the place of the policy
        results["diverged"] = {str(place): said for place, said in sorted(done.diverged.items())}
    return results, saved


def _parameters(
    config: RunConfig, found: TrainedReward | None, demos: Callable[[RunConfig], DemoBatch]
) -> Any:
    """The parameters of a policy's reward, learned or not."""
    frames = policy_rewards.begins_at_frames(config)
    if found is None and not frames:
        return ()
    params, num_classes = (found.params, found.num_classes) if found else (None, 0)
    shown = demos(config) if frames else found.demos
    return policy_rewards.parameters(config, params, shown, num_classes)


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
