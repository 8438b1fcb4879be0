"""The frame of every table: it trains, measures, goes on, joins and writes.

    TABLE = Table("table1", columns, text, pictures, ...)
    frame.make(TABLE, config, settings)              gril table1
    frame.join(TABLE, folders, out)                  gril table1 --join A,B --out OUT

For each row and seed an encoder is trained where the row learns a reward, then measured, and a
policy is trained with the reward where the table has policies. Seeds share a program, and rows do
that compile alike. All that is written is read from the run's files (`read`); it is written again
after each program, so that a run that is cut off leaves what it has, and goes on where it stood.
"""

import dataclasses
import io
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
from gril_jax.experiments.pipeline import demonstrations, setup
from gril_jax.experiments.pipeline.demonstrations import Demonstrations

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, RunError
from gril_jax.report.data import read_versions
from gril_jax.runs import hosts, run_dir
from gril_jax.runs.phases import read_phases
from gril_jax.runs.progress import Progress

from . import measures as table_measures
from . import programs as table_programs
from . import rewards as table_rewards
from .curves import Curve, at_the_end, curves
from .measures import Measure
from .programs import Program
from .rewards import LearnedReward, learns, reward_key
from .rows import Row, Settings, changed, differing, read_settings, with_seeds, write_settings
from .training import learn_policies
from .written import Line, csv, read_csv

__all__ = ["Found", "Table", "join", "make", "read", "read_lines", "redraw", "write"]

Echo = Callable[[str], None]


class Found(NamedTuple):
    """The results of the rows and seeds that have finished, in the order of the table."""

    names: list[str]  # of all rows
    lines: list[Line]
    curves: list[Curve]  # of the policies
    profiles: Mapping[str, Mapping[str, Any]]  # of a row's rewards along demonstrations
    about: Mapping[str, Any]  # command, versions, device, date, and the demonstrations' digest


def _configs(config: RunConfig, settings: Settings) -> list[RunConfig]:
    return [changed(config, change) for change in settings.rows.values()]


def _save(folder: Path, name: str, settings: Settings) -> None:
    write_settings(folder, name, settings)


def _read(table: "Table", folder: Path, settings: Settings) -> Found:
    return read(table, folder, [*settings.rows])


class Table(NamedTuple):
    """One family of tables: its rows are in its settings, the rest is here."""

    name: str  # of its verb and of its files
    columns: Callable[[Sequence[Line]], Sequence[str]]  # of the CSV
    text: Callable[[Found], str]  # in Markdown
    pictures: Callable[[Found, bool], Mapping[str, bytes]]  # by file name; True at the end
    settings: type[Settings] = Settings
    configs: Callable[[RunConfig, Any], Sequence[RunConfig]] = _configs  # one a row
    plan: Callable[[list[Row], int, Any], list[Program]] = lambda rows, num_classes, settings: []
    policy: Callable[[Curve], Mapping[str, Any]] = at_the_end  # its numbers in the lines
    measured: Mapping[str, Sequence[str]] = {}  # measure to its numbers in the lines
    measures: Callable[[RunConfig, Any, Demonstrations], list[Measure]] = lambda *_: []
    reference: Callable[[Demonstrations], list[Line]] = lambda demos: []  # lines of no row
    save: Callable[[Path, str, Any], None] = _save  # the settings
    read: Callable[["Table", Path, Any], Found] = _read
    joins: Callable[["Table", Path, Any], Found] = _read  # of each run that is joined
    order: Sequence[str] = ()  # of rows of joined runs; as they are given where empty
    summary: Callable[[Found], Mapping[str, Any]] = lambda found: {}  # in results.json
    one_set: bool = True  # of demonstrations for all rows


def make(
    table: Table,
    config: RunConfig,
    settings: Any,
    *,
    resume: Path | None = None,
    echo: Echo = print,
) -> Path:
    """Makes a table, or goes on with the run in a folder; returns the run's folder.

    Of several processes (`gril_jax.runs.hosts`) the first alone keeps what it writes, and speaks.

    Args:
      table: its family.
      config: what all rows have in common; each changes fields of it.
      settings: of the table's own kind: the rows, and how many seeds.
      resume: folder of a run with this configuration and these settings.
      echo: takes what is said on the way.

    Raises:
      ConfigError: a row's value is out of range, or a policy does not fit into memory.
      DemoError: the demonstrations do not serve the task.
      RunError: the run cannot be made, or cannot go on.
    """
    rows = with_seeds(table.configs(config, settings), settings.seeds)
    num_classes = len(setup.make_env(config.env, training=False).classes)
    plan = table.plan(rows, num_classes, settings)
    encoders = len({reward_key(row.config) for row in rows if learns(row.config)})
    counts = {
        "encoders": encoders,
        "policies": sum(len(program.rows) for program in plan),
        "programs": len(plan),
    }
    opened = {"device": setup.device_in_words(), "experiment": table.name}
    with hosts.scratch() as scratch:
        shown = None
        if scratch is not None:
            own = dataclasses.replace(config.run, out=str(scratch / "run"), sinks=())
            config, resume = dataclasses.replace(config, run=own), None
            echo, shown = (lambda line: None), io.StringIO()
        with (
            run_dir.create_or_resume(config, resume, **opened) as run,
            Progress(stream=shown) as progress,
        ):
            if resume is None:
                table.save(run.path, table.name, settings)
            said = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
            echo(f"writing to {run.path}: {said}")
            found = _train(table, config, settings, rows, plan, run, progress, echo)
            text = ""
            if hosts.is_first():
                text = write(table, run.path, found)
                counts |= table.summary(found)
            run.finish(counts)
    echo(text)
    echo(f"written to {run.path}")
    return run.path


def _train(table: Table, config, settings, rows, plan, run, progress, echo: Echo) -> Found | None:
    """Rewards, measures and policies, in the order in which programs are compiled."""
    finished = hosts.largest([run.finished_phase(program.name) is not None for program in plan])
    left = [program for program, done in zip(plan, finished, strict=True) if not done]
    free = [one for one in left if not any(learns(row.config) for row in one.rows)]
    others = [one for one in left if one not in free]
    learned: dict[Hashable, LearnedReward] = {}
    gather = _gatherer(run, progress)
    demos = gather(config) if table.one_set else None

    def written() -> None:
        if hosts.is_first():
            write(table, run.path, table.read(table, run.path, settings), last=False)

    def train(program, compiled) -> None:
        done = learn_policies(program, compiled, learned, run, progress, echo)
        run.finish_phase(program.name, done)
        written()

    with ahead.compiling() as pool:
        # First what needs no reward: it keeps the device at work while all else is compiled.
        ready = table_programs.get_ready(free, jax.devices(), pool)
        wanted = table_rewards.get_ready(rows, gather, pool)
        ready |= table_programs.get_ready(others, jax.devices(), pool)
        measures = [] if demos is None else table.measures(config, settings, demos)
        needs = lambda rows: table_rewards.needed(wanted, rows)  # noqa: E731
        ahead.carry_out(
            table_rewards.tasks(wanted, learned, run, progress, echo)
            + table_measures.tasks(
                measures, rows, learned, needs, run, pool, progress, then=written
            )
            + table_programs.tasks(left, ready, needs, train)
        )
    if not hosts.is_first():
        return None
    found = table.read(table, run.path, settings)
    lines = [*found.lines, *([] if demos is None else table.reference(demos))]
    return found._replace(lines=lines)


def _gatherer(run: run_dir.RunDir, progress: Progress) -> Callable[[RunConfig], Demonstrations]:
    """Demonstrations for a configuration, each set made once; the run notes the first one."""
    made: dict[Hashable, Demonstrations] = {}

    def gather(config: RunConfig) -> Demonstrations:
        key = (table_rewards.task_key(config), config.demos)
        if key not in made:
            env = setup.make_env(config.env, training=False)
            if made:
                folder = run.path / f"demos-{len(made)}"
                made[key] = demonstrations.gather(config, env, folder, progress)
            else:
                made[key] = demonstrations.gather_once(config, env, run, progress)
        return made[key]

    return gather


def read(table: Table, folder: Path, names: Sequence[str]) -> Found:
    """The results that the files of a run hold.

    Raises:
      RunError: the folder is no such run, or a file is missing or damaged.
    """
    config, phases = run_dir.read_config(folder), read_phases(folder).finished
    trained = any(name.startswith("policy-") for name in phases)
    found = curves(phases, run_dir.read_metrics(folder) if trained else [])
    lines: dict[tuple[int, int], dict[str, Any]] = {}
    for curve in found:
        tau = {} if curve.tau is None else {"tau": curve.tau}
        lines[curve.cell, curve.seed] = dict(table.policy(curve)) | tau
    for kind, wanted in table.measured.items():
        for cell in range(len(names)):
            for seed, values in enumerate(_by_seed(phases.get(f"{kind}-{cell}", {}), wanted)):
                lines.setdefault((cell, seed), {}).update(values)
    about = read_versions(folder) | {"demos_sha256": phases.get("demos", {}).get("sha256", "")}
    first, numbers = config.run.seed, sorted(lines.items())
    each = [{"row": names[cell], "seed": first + k} | of for (cell, k), of in numbers]
    profiles = {
        name: phases[f"profiles-{cell}"]
        for cell, name in enumerate(names)
        if f"profiles-{cell}" in phases
    }
    return Found([*names], each, found, profiles, about)


def _by_seed(done: Mapping[str, Any], wanted: Sequence[str]) -> list[dict[str, float]]:
    """The numbers of each seed; what was not finite is null in a run's files, and is left out."""
    lists = {name: done[name] for name in wanted if name in done}
    each = done.get("seeds") or [
        dict(zip(lists, values, strict=True)) for values in zip(*lists.values(), strict=True)
    ]
    return [{name: x for name, x in one.items() if x is not None} for one in each]


def read_lines(table: Table, folder: Path, settings: Settings) -> Found:
    """The results that a run's CSV holds, with six digits each.

    Raises:
      RunError: it is missing or damaged.
    """
    file = folder / f"{table.name}.csv"
    try:
        lines = read_csv(file.read_text(encoding="utf-8"), table.columns([]))
    except (OSError, ValueError, KeyError, TypeError):
        raise RunError(
            f"{folder} has no table yet: its {file.name} is missing or damaged"
        ) from None
    return Found([*settings.rows], lines, [], {}, {})


def write(table: Table, folder: Path, found: Found, *, last: bool = True) -> str:
    """Table, lines and pictures of what is known; returns the table."""
    text = table.text(found)
    files = {
        f"{table.name}.md": f"{text}\n".encode(),
        f"{table.name}.csv": csv(found.lines, table.columns(found.lines)).encode(),
    }
    with run_dir.writing(folder):
        for name, contents in (files | dict(table.pictures(found, last))).items():
            (folder / name).write_bytes(contents)
    return text


def redraw(table: Table, folder: Path, echo: Echo = print) -> None:
    """Writes all of a run's table again, from the run's files alone.

    Raises:
      RunError: nothing has finished yet, a file of the run is missing or damaged, or the folder
        cannot be written to.
    """
    found = table.read(table, folder, read_settings(folder, table.name, table.settings))
    if not found.curves:
        raise RunError(f"{folder} has no policy that has finished, so its table is still empty")
    write(table, folder, found)
    echo(f"report: {folder / 'report.html'}")


def join(table: Table, folders: Sequence[Path], out: Path, *, echo: Echo = print) -> None:
    """Writes the table of several runs, such as of runs with different rows, as one.

    Args:
      table: their family.
      folders: of the runs, finished or not.
      out: folder to create.
      echo: takes the table.

    Raises:
      ConfigError: the runs differ in configuration or demonstrations, or have a row in common.
      RunError: a folder is no such run, or has nothing yet.
    """
    settings = [read_settings(folder, table.name, table.settings) for folder in folders]
    each = [table.joins(table, *pair) for pair in zip(folders, settings, strict=True)]
    first, rows = run_dir.read_config(folders[0]), dict[str, Any]()
    for own in settings:
        rows |= own.rows
    for folder, one in zip(folders, each, strict=True):
        other = differing(first, run_dir.read_config(folder), rows)
        if one.about.get("demos_sha256") != each[0].about.get("demos_sha256"):
            other.append("the demonstrations")
        if other:
            what = ", ".join(other)
            raise ConfigError(f"{folder} cannot be joined with {folders[0]}: they differ in {what}")
        if not one.lines:
            raise RunError(f"{folder} has nothing that has finished, so there is nothing to join")
    known = [(line["row"], line["seed"]) for one in each for line in one.lines]
    twice = next((one for one in known if known.count(one) > 1), None)
    if twice is not None:
        raise ConfigError(f"row {twice[0]!r} with seed {twice[1]} is in two of the runs to join")
    run_dir.require_new(out)
    with run_dir.writing(out):
        out.mkdir(parents=True)
    echo(write(table, out, _as_one(each, [*table.order, *rows])))
    echo(f"written to {out}")


def _as_one(each: Sequence[Found], order: Sequence[str]) -> Found:
    """Results of several runs, row by row in this order."""
    given = {name for one in each for name in one.names}
    names = [name for name in dict.fromkeys(order) if name in given]
    curves = [
        dataclasses.replace(curve, cell=names.index(one.names[curve.cell]))
        for one in each
        for curve in one.curves
    ]
    commands = " and ".join(str(one.about.get("command", "")) for one in each)
    return Found(
        names,
        sorted((x for one in each for x in one.lines), key=lambda x: names.index(x["row"])),
        sorted(curves, key=lambda curve: (curve.cell, curve.seed)),
        {row: found for one in each for row, found in one.profiles.items()},
        each[0].about | {"command": commands},
    )
