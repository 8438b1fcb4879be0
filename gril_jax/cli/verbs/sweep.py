"""`gril sweep`: many rewards and policies at once, by a study or by options with commas."""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.config import RunConfig
from gril_jax.config.grid import cells, take_axes
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir
from gril_jax.runs.cluster import cluster_of

from .. import help_page, own_tasks
from ..arguments import Work, echo, existing_folder
from ..heavy_imports import heavy_imports
from ..words import in_full, positional, run_config, take, whole_number
from . import Verb

_ABOUT = (
    "Train every row of a study, such as table1, or every combination of the values given: an "
    "option whose value has commas is an axis, as in --reward learned,environmental --lambda 0.1,1."
)
_OWN = {
    "--seeds N": "Seeds of each row, of which each is one observation. (default: 5)",
    "--rows A,B": "Names of a study's rows, or patterns such as 'ours *'. (default: the study's)",
    "--base CONFIG": "Another configuration than the study's own.",
    "--quick": "The study's smaller version, for a laptop.",
    "--rewards-only": "No policies.",
    "--ascents N": "Gradient ascents of a study's audits.",
    "--starts N": "Starts that share them.",
    "--eval-starts N": "Starts of each variant that finished policies of a study play.",
    "--sets FOLDER": "Demonstration sets, each in a folder of its task's name.",
    "--films FOLDER": "Films, in one folder a task, of which missing sets are made.",
    "--devices all|N": "GPUs, each with a process of its own. (default: all)",
    "--cluster slurm|local": "Parts as jobs; --cluster-options slurm_partition=P,timeout_min=60.",
    "--distributed": "One sweep of all processes of a SLURM or Kubernetes job.",
}
_PROG = "gril sweep"


class _Where(NamedTuple):
    """The processes that do the work."""

    devices: str | None
    cluster: str | None
    options: str | None  # of the cluster's jobs
    job: dict[str, Any] | None  # what connects this process with the others of a job, if any


def _where(args: list[str]) -> _Where:
    devices, cluster = take(args, "--devices"), take(args, "--cluster")
    options = take(args, "--cluster-options")
    job = cluster_of(os.environ) if _flag(args, "--distributed") else None
    if job is not None and (devices or cluster):
        raise ConfigError("--distributed has devices of its own: leave out --devices and --cluster")
    return _Where(devices, cluster, options, job)


def _flag(args: list[str], option: str) -> bool:
    if option not in args:
        return False
    args.remove(option)
    return True


def _plan(args: list[str]) -> Work:
    where, resume = _where(args), take(args, "--resume")
    if resume is not None:
        return _resume(Path(resume), args, where)
    from gril_jax.workflows.study import recipe
    from gril_jax.workflows.study.rows import without_twins
    from gril_jax.workflows.study.saved import Plan

    name = positional(args)
    of = recipe.load(name, quick=_flag(args, "--quick")) if recipe.is_study(name) else None
    study = recipe.Study("sweep", measure={"audit": {}}) if of is None else of.study
    study, films = _with_own(study, args), take(args, "--films")
    if films is not None:
        existing_folder(films)
    if of is None:
        config, rows = _grid(name, args)
        chosen = rows
    else:
        config, rows, chosen = _rows_of(of, args)
    kept, twins = without_twins(chosen)
    plan = Plan(study, config, rows, {row: range(study.seeds) for row in kept})
    said = [f"the row {one!r} is left out: it is {other!r} again" for one, other in twins.items()]
    return _made(plan, where, films=films, said=said)


def _with_own(study: Any, args: list[str]) -> Any:
    """The study with the options that are its own taken off the arguments."""
    seeds = whole_number(args, "--seeds", study.seeds)
    policies = study.policies and not _flag(args, "--rewards-only")
    measure = {kind: dict(options) for kind, options in study.measure.items()}
    for option, kind, field in (
        ("--ascents", "audit", "ascents"), ("--starts", "audit", "starts"),
        ("--eval-starts", "variants", "starts"),
    ):  # fmt: skip
        number = whole_number(args, option, None)
        if number is not None and kind not in measure:
            raise ConfigError(f"{option} is given, but the study does not measure {kind}")
        if number is not None:
            measure[kind][field] = number
    return dataclasses.replace(study, seeds=seeds, policies=policies, measure=measure)


def _grid(name: str | None, args: list[str]) -> tuple[RunConfig, dict[str, RunConfig]]:
    """What all combinations of the options with commas have in common, and each of them by name."""
    args[:] = in_full(args)
    axes = take_axes(args)
    config = run_config(name, args, _PROG, _ABOUT, help_page.SWEEP, own=_OWN)

    def one(options: list[str]) -> RunConfig:  # a set may be a value of an axis
        return run_config(name, options, _PROG, _ABOUT, help_page.SWEEP)

    found = {cell.name: cell.config for cell in cells(axes, args, one)} if axes else {}
    for each in found.values() or [config]:
        if each.run.reward_source is not None:
            raise ConfigError(
                f"run.reward is {each.run.reward}, but a sweep learns its rewards itself: only "
                "gril train takes one that has been learned"
            )
    return config, found or {"as configured": config}


def _rows_of(
    of: Any, args: list[str]
) -> tuple[RunConfig, dict[str, RunConfig], dict[str, RunConfig]]:
    """What a study's rows have in common, all of these, and those that are chosen.

    An option of the command line counts for all rows, whatever they say themselves.
    """
    from gril_jax.workflows.study.rows import changed, chosen, located

    patterns, base = take(args, "--rows"), take(args, "--base") or of.base
    sets = take(args, "--sets") or of.sets
    wanted = of.default if patterns is None else [name.strip() for name in patterns.split(",")]
    names = chosen(wanted, [*of.rows])
    sections = vars(RunConfig())
    options = (arg[2:].partition("=")[0].replace("-", "_") for arg in in_full(args))
    given = {located(one) for one in options if one.partition(".")[0] in sections and "." in one}
    args[:0] = [word for path, value in of.changes.items() for word in _words(path, value)]
    config, found = _grid(base, args)
    _require_algorithm({name: of.rows[name] for name in names}, config)
    rows, mine = dict[str, RunConfig](), dict[str, RunConfig]()
    for name, change in of.rows.items():
        own = {p: x for p, x in {**change, **of.over}.items() if located(p) not in given}
        for cell, common in found.items():
            row = name if len(found) == 1 else f"{name}, {cell}"
            one = rows[row] = changed(common, own)
            if sets is not None and ("demos", "path") not in given:
                rows[row] = changed(one, {"demos.path": str(Path(sets) / one.env.name)})
            if name in names:
                mine[row] = rows[row]
    return config, rows, mine


def _words(path: str, value: Any) -> list[str]:
    values = value if isinstance(value, list) else [value]
    return [f"--{path.replace('_', '-')}", *map(str, values)]


def _require_algorithm(rows: Mapping[str, Mapping[str, Any]], config: RunConfig) -> None:
    """Raises ConfigError if rows set what the algorithm that trains does not read."""
    other = {"ppo": "sac", "sac": "ppo"}[config.run.algorithm]
    for row, change in rows.items():
        if stray := [path for path in change if path.startswith(f"{other}.")]:
            raise ConfigError(
                f"run.algorithm is {config.run.algorithm!r}, but must be {other!r}, because the "
                f"row {row!r} sets {stray[0]}"
            )


def _resume(folder: Path, args: list[str], where: _Where) -> Work:
    """The work that is left of a run, and with --rows or --seeds more of its study."""
    from gril_jax.workflows.study import saved
    from gril_jax.workflows.study.rows import chosen

    task, patterns = take(args, "--task"), take(args, "--rows")
    seeds = whole_number(args, "--seeds", None)
    if args:
        raise ConfigError(
            f"--resume takes its options from {folder}, so {args[0]} must not be given beside it"
        )
    more = patterns is not None or seeds is not None
    # Processes of a job that look at the same time are in each other's way: the first one will.
    config = run_dir.read_config(folder)
    if not (more or where.job is not None or saved.left(folder)):
        run_dir.require_resumable(folder, saved.EXPERIMENT)
    own_tasks.of_run(config, task, folder)
    plan = saved.read(folder)
    if not more:
        return _made(plan, where, folder, parts=plan.in_parts or bool(saved.left(folder)))
    if not (plan.in_parts or (folder / "results.json").is_file()):
        raise RunError(
            f"the run in {folder} has not finished: gril sweep --resume {folder} goes on with it, "
            "and then it may have more rows"
        )
    names = [*plan.work]
    if patterns is not None:
        names = chosen([name.strip() for name in patterns.split(",")], [*plan.rows])
    work = plan.work | {name: range(seeds or plan.study.seeds) for name in names}
    return _made(plan._replace(work=work), where, folder, parts=True)


def _made(
    plan: Any,
    where: _Where,
    resume: Path | None = None,
    *,
    parts: bool = False,
    films: str | None = None,
    said: Sequence[str] = (),
) -> Work:
    """A new study, or one to go on with; in `parts` if processes of their own make it."""

    def work() -> int:
        from gril_jax.workflows.study.devices import slots

        environment = dict(os.environ)
        devices = [None] if where.cluster or where.job is not None else slots(where.devices)
        count = min(len(devices), len(plan.runs))
        apart = parts or bool(where.cluster) or (count > 1 and resume is None)
        if apart:
            os.environ["JAX_PLATFORMS"] = "cpu"  # the devices are for the other processes
        elif where.devices is not None and devices[0] is not None:
            os.environ["CUDA_VISIBLE_DEVICES"] = ",".join(filter(None, devices))
        with heavy_imports(plan.config, devices=where.job is None):
            if where.job is not None:  # before anything else touches JAX
                from gril_jax.runs import hosts

                hosts.initialize(where.job)
            from gril_jax.workflows.study import cluster, driver, sets
            from gril_jax.workflows.study import parts as processes
        for sentence in said:
            echo(sentence)
        if resume is None:
            sets.make([plan.rows[name] for name in plan.work], films, echo)
        if not apart:
            return driver.make(plan, resume=resume, echo=echo)
        carry_out = processes.on_this_machine(devices, environment, echo)
        if where.cluster:
            options = cluster.require_known(where.cluster, where.options)
            carry_out = cluster.jobs(where.cluster, options, echo)
            count = int(where.devices) if (where.devices or "").isdecimal() else len(plan.work)
        return processes.make(plan, count, carry_out, resume=resume, echo=echo)

    return work


VERBS = (
    Verb(
        "sweep STUDY|CONFIG --seeds N",
        "a study such as table1, or every combination of options with commas, over seeds; "
        "--resume RUN goes on, --quick on a laptop",
        _plan,
    ),
)
