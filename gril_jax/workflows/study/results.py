"""One family of tables as a value; the results of its runs: read, joined, and written."""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, RunError
from gril_jax.report.data import read_versions
from gril_jax.report.figures.style import png
from gril_jax.runs import run_dir, times
from gril_jax.runs.covered import require_unchanged
from gril_jax.runs.phases import read_phases
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.build.given import of_all

from .counted import COUNTS, Counted
from .curves import Curve, at_the_end, curves
from .measures import Measure
from .programs import Program
from .rows import Row, Settings, changed, differing, read_settings, write_settings
from .written import Line, csv, read_csv

Echo = Callable[[str], None]


class Found(NamedTuple):
    """The results of the rows and seeds that have finished, in the order of the table."""

    names: list[str]  # of all rows
    lines: list[Line]
    curves: list[Curve]  # of the policies
    profiles: Mapping[str, Mapping[str, Any]]  # of a row's rewards along demonstrations
    about: Mapping[str, Any]  # command, versions, device, date, and the demonstrations' digest

    @property
    def starts(self) -> Mapping[str, Counted]:
        """The starts of each policy's evaluations, by variant; empty if not recorded of all."""
        each = [curve.starts for curve in self.curves]
        return each[0] if each and all(one == each[0] for one in each) else {}

    @property
    def variant(self) -> str:
        """The variant of the task that `success` is counted from; empty if not recorded."""
        return next(iter(self.starts), "")


class Table(NamedTuple):
    """One family of tables: its rows are in its settings, the rest is here."""

    name: str  # of its verb and of its files
    columns: Callable[[Sequence[Line]], Sequence[str]]  # of the CSV
    text: Callable[[Found], str]  # in Markdown
    figure: Callable[[Found], Figure | None]  # None before there is anything to draw
    picture: str = ""  # the figure's file, if not NAME.png
    page: Callable[[Found, bytes], str] | None = None  # with the figure; both at the end alone
    page_in: Callable[[Found, bytes, Path], str] | None = None  # the same, from its folder too
    settings: type[Settings] = Settings
    prepare: Callable[[Any, Echo], None] = lambda *_: None  # before a run, from its settings
    configs: Callable[[RunConfig, Any], Sequence[RunConfig]] = lambda config, settings: [
        changed(config, change) for change in settings.rows.values()
    ]  # one a row
    # The policies' programs, from the rows, the settings and what groups rows into programs.
    plan: Callable[[list[Row], Any, Callable[..., list[Program]]], list[Program]] = lambda *_: []
    policy: Callable[[Curve], Mapping[str, Any]] = at_the_end  # its numbers in the lines
    measured: Mapping[str, Sequence[str]] = {}  # measure to its numbers in the lines
    measures: Callable[[RunConfig, Any, Demonstrations | None], list[Measure]] = lambda *_: []
    reference: Callable[[Demonstrations], list[Line]] = lambda demos: []  # lines of no row
    save: Callable[[Path, str, Any], list[Path]] = write_settings  # returns the files
    load: Callable[[Path, str, type[Settings]], Any] = read_settings  # what `save` has written
    names: Callable[[Any], Sequence[str]] = lambda settings: [*settings.rows]
    complete: Callable[[Found, Any], Found] = lambda found, settings: found  # as read from a run
    newer: Sequence[str] = ()  # columns that older CSVs lack
    joins_csv: bool = False  # tables of joined runs are made of their CSV alone
    order: Sequence[str] = ()  # of rows of joined runs; as they are given where empty
    summary: Callable[[Found], Mapping[str, Any]] = lambda found: {}  # in results.json
    one_set: bool = True  # of demonstrations for all rows
    # What follows the training of a program, from all of them, the settings and a compilers' pool.
    after: Callable[[Sequence[Program], Any, Any], Callable[[Program, Any], None]] = lambda *_: (
        lambda *_: None
    )


def read(table: Table, folder: Path, settings: Any) -> Found:
    """The results that the files of a run hold; RunError if one is missing or damaged."""
    config, phases = run_dir.read_config(folder), read_phases(folder).finished
    names = [*table.names(settings)]
    trained = any(name.startswith("policy-") for name in phases)
    found = curves(phases, run_dir.read_metrics(folder, clocks=True) if trained else [])
    lines: dict[tuple[int, int], dict[str, Any]] = {}
    for curve in found:
        tau = {} if curve.tau is None else {"tau": curve.tau}
        lines[curve.cell, curve.seed] = dict(table.policy(curve)) | tau
    for kind, cell in itertools.product(table.measured, range(len(names))):
        done = phases.get(f"{kind}-{cell}", {})
        for seed, values in enumerate(_by_seed(done, table.measured[kind])):
            lines.setdefault((cell, seed), {}).update(values)
    about = read_versions(folder) | {"started": times.started(folder)}
    about |= {"demos_sha256": phases.get("demos", {}).get("sha256", "")}
    if trained:
        about["given"] = of_all(table.configs(config, settings))
    first, numbers = config.run.seed, sorted(lines.items())
    each = [{"row": names[cell], "seed": first + k} | of for (cell, k), of in numbers]
    known = {name: phases.get(f"profiles-{cell}") for cell, name in enumerate(names)}
    profiles = {name: one for name, one in known.items() if one is not None}
    return table.complete(Found(names, each, found, profiles, about), settings)


def _by_seed(done: Mapping[str, Any], wanted: Sequence[str]) -> list[dict[str, float]]:
    """The numbers of each seed; what was not finite is null in a run's files, and is left out."""
    lists = {name: done[name] for name in wanted if name in done}
    each = done.get("seeds") or [
        dict(zip(lists, values, strict=True)) for values in zip(*lists.values(), strict=True)
    ]
    return [{name: x for name, x in one.items() if x is not None} for one in each]


def _read_csv(table: Table, folder: Path, settings: Settings) -> Found:
    """The results that a run's CSV holds, with six digits each."""
    file = folder / f"{table.name}.csv"
    require_unchanged(folder, file.name)
    try:
        lines = read_csv(
            file.read_text(encoding="utf-8"), table.columns([]), [*COUNTS, *table.newer]
        )
    except (OSError, ValueError, KeyError, TypeError):
        raise RunError(
            f"{folder} has no table yet: its {file.name} is missing or damaged"
        ) from None
    return Found([*settings.rows], lines, [], {}, {})


def write(table: Table, folder: Path, found: Found, *, last: bool = True) -> str:
    """Table, lines and pictures of what is known; returns the table.

    Those of a table with a page take seconds: it has them at the end alone.
    """
    text = "\n\n".join(filter(None, (table.text(found), found.about.get("given"))))
    files = {
        f"{table.name}.md": f"{text}\n".encode(),
        f"{table.name}.csv": csv(found.lines, table.columns(found.lines)).encode(),
    }
    paged = table.page is not None or table.page_in is not None
    figure = table.figure(found) if last or not paged else None
    if figure is not None:
        picture = files[table.picture or f"{table.name}.png"] = png(figure)
        if table.page is not None:
            files["report.html"] = table.page(found, picture).encode()
        if table.page_in is not None:
            files["report.html"] = table.page_in(found, picture, folder).encode()
    with run_dir.writing(folder):
        for name, contents in files.items():
            (folder / name).write_bytes(contents)
    return text


def redraw(table: Table, folder: Path, echo: Echo = print) -> None:
    """Writes all of a run's table again, from its files alone; RunError if nothing has finished."""
    found = read(table, folder, table.load(folder, table.name, table.settings))
    if not found.curves:
        raise RunError(f"{folder} has no policy that has finished, so its table is still empty")
    write(table, folder, found)
    echo(f"report: {folder / 'report.html'}")


def join(table: Table, folders: Sequence[Path], out: Path, *, echo: Echo = print) -> None:
    """Writes the table of several runs, such as of runs with different rows, as one.

    Raises ConfigError if the runs differ in more, or have a row in common.
    """
    settings = [read_settings(folder, table.name, table.settings) for folder in folders]
    found_in = _read_csv if table.joins_csv else read
    each = [found_in(table, *pair) for pair in zip(folders, settings, strict=True)]
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
    for row, seed in known:
        if known.count((row, seed)) > 1:
            raise ConfigError(f"row {row!r} with seed {seed} is in two of the runs to join")
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
