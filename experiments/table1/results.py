"""What runs of Table I have come to so far, from their files alone, and the table made of it."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.experiments.sweeps import named_rows, table_csv

from gril_jax.errors import ConfigError, RunError
from gril_jax.report.data import read_versions
from gril_jax.report.figures.style import png
from gril_jax.runs import run_dir
from gril_jax.runs.phases import read_phases

from . import page as table1_page
from . import plot as table1_plot
from . import table as table1_table
from .rows import ROWS, read_settings
from .scores import Curve, curves, in_last_tenth, summary

__all__ = ["Results", "join", "read", "write", "write_table"]


class Results(NamedTuple):
    """Of the policies that have finished, row by row in the order of the table."""

    curves: list[Curve]
    lines: list[table1_table.Line]  # of each curve
    looks: dict[str, Mapping[str, Any]]  # row to what `table1_profiles.measure` found
    about: dict[str, Any]  # command, versions, device, date, and the demonstrations' digest


def read(folder: Path) -> Results:
    """What the files of one run say.

    Raises:
      RunError: the folder is no such run, or a file is missing or damaged.
    """
    config, names = run_dir.read_config(folder), [*read_settings(folder).rows]
    finished = read_phases(folder).finished
    programs = {k: x for k, x in finished.items() if k.startswith("policy-")}
    metrics = run_dir.read_metrics(folder) if programs else []
    found: list[tuple[Curve, table1_table.Line]] = []
    for name, done in programs.items():
        own = curves(names, done["rows"], [m for m in metrics if m["phase"] == name])
        for curve, tau in zip(own, done["taus"], strict=True):
            line = {"row": curve.row, "seed": config.run.seed + curve.seed} | summary(curve)
            if tau is not None:
                line |= {"tau": tau} | _figures(finished, names.index(curve.row), curve.seed)
            found.append((curve, line))
    about = read_versions(folder) | {"demos_sha256": finished.get("demos", {}).get("sha256", "")}
    looks = {name: finished.get(f"profiles-{cell}") for cell, name in enumerate(names)}
    return _in_order(found, {k: x for k, x in looks.items() if x is not None}, about, names)


def _figures(finished: Mapping[str, Any], cell: int, seed: int) -> dict[str, float]:
    """What was measured of a learned reward; what was not finite is null in a run's files."""
    audit, looks = (finished.get(f"{kind}-{cell}", {}) for kind in ("audit", "profiles"))
    figures = audit | {name: looks[name] for name in ("cycle",) if name in looks}
    return {name: values[seed] for name, values in figures.items() if values[seed] is not None}


def _in_order(found: Iterable[tuple[Curve, Any]], looks, about, names: Sequence[str]) -> Results:
    pairs = sorted(found, key=lambda pair: (names.index(pair[0].row), pair[0].seed))
    own = [curve for curve, _ in pairs]
    return Results(own, [line for _, line in pairs], looks, about)


def join(folders: Sequence[Path]) -> Results:
    """What several runs with different rows say, as if they were one.

    Raises:
      ConfigError: the runs differ in configuration or demonstrations, or have a row in common.
      RunError: see `read`.
    """
    first, each = run_dir.read_config(folders[0]), [read(folder) for folder in folders]
    changes = {k: x for folder in folders for k, x in read_settings(folder).rows.items()}
    for folder, one in zip(folders, each, strict=True):
        differing = named_rows.differing(first, run_dir.read_config(folder), changes)
        if one.about["demos_sha256"] != each[0].about["demos_sha256"]:
            differing.append("the demonstrations")
        if differing:
            what = ", ".join(differing)
            raise ConfigError(f"{folder} cannot be joined with {folders[0]}: they differ in {what}")
        if not one.lines:
            raise RunError(f"{folder} has no policy that has finished, so there is nothing to join")
    rows = [row for one in each for row in {curve.row: None for curve in one.curves}]
    twice = next((row for row in rows if rows.count(row) > 1), None)
    if twice is not None:
        raise ConfigError(f"row {twice!r} is in two of the runs to join")
    commands = " and ".join(str(one.about.get("command", "")) for one in each)
    return _in_order(
        [pair for one in each for pair in zip(one.curves, one.lines, strict=True)],
        {row: look for one in each for row, look in one.looks.items()},
        each[0].about | {"command": commands},
        [*ROWS, *(row for row in rows if row not in ROWS)],
    )


def write(folder: Path, results: Results) -> str:
    """Table, a line for each policy, figure and page; returns the table."""
    table = write_table(folder, results)
    figure = png(table1_plot.figure(results.curves))
    page = table1_page.page(results.lines, table, figure, results.looks, results.about)
    with run_dir.writing(folder):
        (folder / "figure2.png").write_bytes(figure)
        (folder / "report.html").write_text(page, encoding="utf-8")
    return table


def write_table(folder: Path, results: Results) -> str:
    """The table and the lines alone, without seconds spent on pictures; returns the table."""
    evaluations = int(in_last_tenth(results.curves[0].env_steps).sum())
    table = table1_table.markdown(results.lines, results.about, evaluations=evaluations)
    lines = table_csv.written(results.lines, table1_table.COLUMNS)
    with run_dir.writing(folder):
        (folder / "table1.md").write_text(table + "\n", encoding="utf-8")
        (folder / "table1.csv").write_text(lines, encoding="utf-8")
    return table
