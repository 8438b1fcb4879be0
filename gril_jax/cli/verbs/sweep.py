"""`gril sweep`: many rewards and policies at once, by a study or by options with commas."""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from gril_jax.config import RunConfig
from gril_jax.config.command_line import options, parse
from gril_jax.config.grid import cells, take_axes
from gril_jax.config.run_config import Sections
from gril_jax.config.tables import count, optional
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir
from gril_jax.runs.cluster import cluster_of

from ..arguments import Work, echo, existing_folder, require_task_of
from ..configured import new_run, read, start, without_help
from ..devices import slots
from ..heavy_imports import heavy_imports
from . import Verb

_PROG = "gril sweep"
_ABOUT = (
    "Train every row of a study, such as table1, or every combination of the values given: an "
    "option whose value has commas is an axis, as in --reward learned,environmental --lambda 0.1,1."
)


@dataclass(frozen=True)
class _Own:
    config: Annotated[
        str | None,
        tyro.conf.Positional,
        tyro.conf.arg(
            metavar="STUDY|CONFIG", help="One that is shipped, or the path of a YAML file."
        ),
    ] = None
    resume: str | None = None
    """Folder of a run to go on with; with --rows or --seeds it makes more of its study."""
    seeds: int | None = field(default=None, metadata=optional(count()))
    """Seeds of each row, each one observation; None: the study's, or 5."""
    rows: str | None = None
    """Names of a study's rows, or patterns such as 'ours *', with commas; None: the study's."""
    base: str | None = None
    """A configuration in place of the study's own."""
    quick: bool = False
    """The study's smaller version, for a laptop."""
    rewards_only: bool = False
    """Learn rewards alone, without policies."""
    dry_run: bool = False
    """Say what each row would train, and how much that is, and write nothing."""
    ascents: int | None = field(default=None, metadata=optional(count()))
    """Gradient searches in a study's audits."""
    starts: int | None = field(default=None, metadata=optional(count()))
    """Starts of each audit, which share these searches."""
    eval_starts: int | None = field(default=None, metadata=optional(count()))
    """Starts of each variant that finished policies of a study play."""
    sets: str | None = None
    """Folder of demonstration sets, each in a folder of its task's name."""
    videos: str | None = None
    """Folder with a folder of videos for each task, to make missing sets from."""
    devices: str | None = None
    """GPUs, each with a process of its own: all, or a number; None: all."""
    cluster: Literal["slurm", "local"] | None = None
    """Run the parts as jobs of a cluster."""
    cluster_options: str | None = None
    """Options of these jobs, such as slurm_partition=P,timeout_min=60."""
    distributed: bool = False
    """Run one sweep in all processes of a SLURM or Kubernetes job."""


@dataclass(frozen=True)
class _Sweep(_Own, Sections):
    pass


_BESIDE_RESUME = {
    "--resume", "--rows", "--seeds", "--task", "--env.name", "--devices", "--cluster",
    "--cluster-options", "--distributed",
}  # fmt: skip
_OF_MEASURES = {
    "ascents": ("audit", "ascents"), "starts": ("audit", "starts"),
    "eval_starts": ("variants", "starts"),
}  # fmt: skip


def _plan(args: list[str]) -> Work:
    from gril_jax.workflows.study import recipe, saved

    words = [arg.partition("=")[0].replace("_", "-") for arg in args]
    axes = take_axes(args)
    plain, asks, _ = without_help(_Sweep(), args)
    given = parse(_Sweep, plain, default=_Sweep(), prog=_PROG, add_help=False)
    if given.resume is not None and not asks:
        return _resume(given, words)
    is_study = recipe.is_study(given.config)
    study = recipe.load(given.config, quick=given.quick) if is_study else None
    if given.videos is not None:
        existing_folder(given.videos)

    def begin(given: _Sweep) -> Sections | None:
        if study is None:
            return start(given)
        below = start(dataclasses.replace(given, config=given.base or study.base))
        return recipe.changed(below or Sections(), study.changes)

    def config(more: Sequence[str] = ()) -> RunConfig:
        return new_run(read(_Sweep(), [*args, *more], _PROG, _ABOUT, begin), _PROG)

    common = config()
    grid = {name: config(more) if more else common for name, more in cells(axes).items()}
    rows, chosen = grid, {*grid}
    if study is None:
        study = recipe.Study("sweep", measure={"audit": {}})
    else:
        every = options(RunConfig)
        said = {every[word].path for word in words if word in every}
        rows, chosen = _rows(study, given, grid, said)
    for name in chosen:
        if rows[name].run.reward_source is not None:
            raise ConfigError(
                f"run.reward is {rows[name].run.reward}, but a sweep learns its rewards itself: "
                "only gril train takes one that has been learned"
            )
    study = _with_own(study, given)
    kept, twins = saved.without_twins({name: x for name, x in rows.items() if name in chosen})
    plan = saved.Plan(study, common, rows, {row: range(study.seeds) for row in kept})
    said = [f"the row {one!r} is left out: it is {other!r} again" for one, other in twins.items()]
    return _made(plan, given, said=said)


def _with_own(study: Any, given: _Own) -> Any:
    """The study with the options that are its own."""
    measure = {kind: dict(options) for kind, options in study.measure.items()}
    for name, (kind, option) in _OF_MEASURES.items():
        number = getattr(given, name)
        if number is not None and kind not in measure:
            word = name.replace("_", "-")
            raise ConfigError(f"--{word} is given, but the study does not measure {kind}")
        if number is not None:
            measure[kind][option] = number
    policies = study.policies and not given.rewards_only
    seeds = given.seeds or study.seeds
    return dataclasses.replace(study, seeds=seeds, policies=policies, measure=measure)


def _rows(
    study: Any, given: _Own, grid: Mapping[str, RunConfig], said: set[tuple[str, ...]]
) -> tuple[dict[str, RunConfig], set[str]]:
    """All rows of a study, each with every combination of the options with commas, and the names of
    those that are chosen.

    An option of the command line, those in `said`, counts for all rows, whatever they say
    themselves.
    """
    from gril_jax.workflows.study.recipe import changed, chosen, located

    wanted = study.default if given.rows is None else _listed(given.rows)
    names = chosen(wanted, [*study.rows])
    _require_algorithm({name: study.rows[name] for name in names}, next(iter(grid.values())))
    sets, rows, mine = given.sets or study.sets, dict[str, RunConfig](), set[str]()
    for name, change in study.rows.items():
        own = {p: x for p, x in {**change, **study.over}.items() if located(p) not in said}
        for cell, common in grid.items():
            row = name if len(grid) == 1 else f"{name}, {cell}"
            rows[row] = changed(common, own)
            if sets is not None and ("demos", "path") not in said:
                path = str(Path(sets) / rows[row].env.name)
                rows[row] = changed(rows[row], {"demos.path": path})
            if name in names:
                mine.add(row)
    return rows, mine


def _listed(rows: str) -> list[str]:
    return [name.strip() for name in rows.split(",")]


def _require_algorithm(rows: Mapping[str, Mapping[str, Any]], config: RunConfig) -> None:
    """Raises ConfigError if rows set what the algorithm that trains does not read."""
    other = {"ppo": "sac", "sac": "ppo"}[config.run.algorithm]
    for row, change in rows.items():
        if stray := [path for path in change if path.startswith(f"{other}.")]:
            raise ConfigError(
                f"run.algorithm is {config.run.algorithm!r}, but must be {other!r}, because the "
                f"row {row!r} sets {stray[0]}"
            )


def _resume(given: _Sweep, words: Sequence[str]) -> Work:
    """The work that is left of a run, and with --rows or --seeds more of its study."""
    from gril_jax.workflows.study import recipe, saved

    folder = Path(given.resume)
    stray = [word for word in words if word.startswith("--") and word not in _BESIDE_RESUME]
    if stray or given.config is not None:
        raise ConfigError(
            f"--resume takes its options from {folder}, so {[*stray, given.config][0]} must not be "
            "given beside it"
        )
    more = given.rows is not None or given.seeds is not None
    # Processes of a job that look at the same time are in each other's way: the first one will.
    config = run_dir.read_config(folder)
    if not (more or given.distributed or saved.left(folder)):
        run_dir.require_resumable(folder, saved.EXPERIMENT)
    task = given.env.name if {"--task", "--env.name"} & {*words} else None
    require_task_of(config, task, folder)
    plan = saved.read(folder)
    if not more:
        return _made(plan, given, folder, parts=plan.in_parts or bool(saved.left(folder)))
    if not (plan.in_parts or (folder / "results.json").is_file()):
        raise RunError(
            f"the run in {folder} has not finished: gril sweep --resume {folder} goes on with it, "
            "and then it may have more rows"
        )
    names = [*plan.work]
    if given.rows is not None:
        names = recipe.chosen(_listed(given.rows), [*plan.rows])
    work = plan.work | {name: range(given.seeds or plan.study.seeds) for name in names}
    return _made(plan._replace(work=work), given, folder, parts=True)


def _made(
    plan: Any,
    given: _Own,
    resume: Path | None = None,
    *,
    parts: bool = False,
    said: Sequence[str] = (),
) -> Work:
    """A new study, or one to go on with; in `parts` if processes of their own make it."""
    job = cluster_of(os.environ) if given.distributed else None
    if job is not None and (given.devices or given.cluster):
        raise ConfigError("--distributed has devices of its own: leave out --devices and --cluster")
    if given.dry_run and (given.devices or given.cluster or given.distributed):
        raise ConfigError(
            "--dry-run is told by one process: leave out --devices, --cluster and --distributed"
        )
    if given.dry_run:
        return lambda: _told(plan, given.videos, said)

    def work() -> int:
        environment = dict(os.environ)
        devices = [None] if given.cluster or job is not None else slots(given.devices)
        count = min(len(devices), len(plan.runs))
        apart = parts or bool(given.cluster) or (count > 1 and resume is None)
        if apart:
            os.environ["JAX_PLATFORMS"] = "cpu"  # the devices are for the other processes
        elif given.devices is not None and devices[0] is not None:
            os.environ["CUDA_VISIBLE_DEVICES"] = ",".join(filter(None, devices))
        with heavy_imports(plan.config, devices=job is None):
            if job is not None:  # before anything else touches JAX
                from gril_jax.runs import hosts

                hosts.initialize(job)
            from gril_jax.workflows.study import driver
            from gril_jax.workflows.study import parts as processes
        for sentence in said:
            echo(sentence)
        if resume is None:
            driver.make_sets([plan.rows[name] for name in plan.work], given.videos, echo)
        if not apart:
            return driver.make(plan, resume=resume, echo=echo)
        carry_out = processes.on_this_machine(devices, environment, echo)
        if given.cluster:
            carry_out = processes.on_a_cluster(given.cluster, given.cluster_options, echo)
            number = given.devices or ""
            count = int(number) if number.isdecimal() else len(plan.work)
        return processes.make(plan, count, carry_out, resume=resume, echo=echo)

    return work


def _told(plan: Any, videos: str | None, said: Sequence[str]) -> int:
    with heavy_imports(plan.config, devices=True):
        from gril_jax.workflows.study import dry_run
    for sentence in said:
        echo(sentence)
    return dry_run.main(plan, videos, echo)


VERBS = {
    "Compare, over seeds": (
        Verb(
            "sweep STUDY|CONFIG --seeds N",
            "a study such as table1, or every combination of options with commas, over seeds; "
            "--resume RUN goes on, --quick on a laptop",
            _plan, schema=_Sweep,
        ),
    )
}  # fmt: skip
