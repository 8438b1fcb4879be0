"""All combinations of some options with several seeds, in as few compiled programs as possible.

    gril sweep quickstart --seeds 8 --reward learned,environmental --lambda 0.1,1
    gril sweep match_regions --rows "environmental,XIRL" --ppo.learning-rate 3e-4,7e-4

Writes `sweep.md`, `sweep.csv`, `sweep.png`, the final policies, and one configuration a cell, which
`gril train RUN/cells/000.yaml` runs by itself.
"""

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gril_jax.config import RunConfig
from gril_jax.config.files import load, to_yaml
from gril_jax.config.grid import Cell
from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.runs.covered import require_part, require_unchanged

from ..tables.counted import of_lines, success_columns
from ..tables.curves import LAST, Curve, at_the_end, learning_curves
from ..tables.results import Found, Table
from ..tables.rewards import learns
from ..tables.written import (
    SEEDS,
    Column,
    Section,
    markdown,
    mean_interval,
    median_reached,
)

_COLUMNS = ("cell", "seed", *LAST, "steps_80", "tau")
_REACHED = median_reached(unit=1e-6, digits=2)


def _sections(found: Found) -> list[Section]:
    among = of_lines(found.lines, found.variant)
    return [
        Section(
            "Mean; interquartile mean with its 95 % bootstrap interval over policies, each of "
            "which is one observation: its success in its last evaluation, from fresh starts. "
            "Steps are those at the first evaluation with a success of at least 80 % (sampled "
            "actions), the median over policies, of which those that never got there come last, "
            "and how many got there.",
            (
                SEEDS._replace(heading="policies"),
                *success_columns(found.lines, found.variant),
                Column("steps_80", "M env steps to 80 %", _REACHED, among="env_steps"),
            ),
        ),
        Section(
            "The same of other scores, with deterministic actions, and the mean of the learned "
            "rewards' tau:",
            (
                Column("success_ever", f"success at some moment, {among}", mean_interval()),
                Column("score", "score", mean_interval()),
                Column("tau", "tau", lambda values, count: f"{values.mean():.3f}"),
            ),
        ),
    ]


@dataclasses.dataclass(frozen=True)
class Sweep:
    """All of a sweep that is not in its first cell's configuration."""

    cells: Sequence[Cell]
    seeds: int


def read_cells(folder: Path) -> Sweep:
    """The cells of a sweep and its number of seeds; RunError if the folder is none."""
    require_unchanged(folder, "sweep.json")
    require_part(folder, "cells")
    try:
        about = json.loads((folder / "sweep.json").read_text(encoding="utf-8"))
        cells = [
            Cell(tuple(map(tuple, labels)), load(str(folder / "cells" / f"{i:03}.yaml")))
            for i, labels in enumerate(about["cells"])
        ]
        return Sweep(cells, int(about["seeds"]))
    except (OSError, ValueError, KeyError, TypeError):
        raise RunError(f"{folder} is not a sweep: its sweep.json is missing or damaged") from None


def _write_cells(folder: Path, name: str, sweep: Sweep) -> list[Path]:
    about = {"seeds": sweep.seeds, "cells": [cell.labels for cell in sweep.cells]}
    files = {folder / "sweep.json": json.dumps(about, indent=1) + "\n"}
    for i, cell in enumerate(sweep.cells):
        files[folder / "cells" / f"{i:03}.yaml"] = to_yaml(cell.config)
    with run_dir.writing(folder):
        (folder / "cells").mkdir()
        for file, text in files.items():
            file.write_text(text, encoding="utf-8")
    return [*files]


def _first_of_twins(sweep: Sweep) -> list[int]:
    """For each cell the first one with the same policies, which ignore some of the fields."""
    usual = RunConfig()
    unused = {name: getattr(usual, name) for name in ("demos", "encoder", "loss", "pretrain")}
    configs = [cell.config for cell in sweep.cells]
    counts = [one if learns(one) else dataclasses.replace(one, **unused) for one in configs]
    return [counts.index(one) for one in counts]


def _plan(rows, sweep: Sweep, programs):
    first = _first_of_twins(sweep)
    return programs([row for row in rows if first[row.cell] == row.cell])


def _policy(curve: Curve) -> dict[str, float | int]:
    numbers = at_the_end(curve)
    return numbers | {k: int(numbers[k]) for k in ("env_steps", "steps_80") if numbers[k] < np.inf}


def _with_twins(found: Found, sweep: Sweep) -> Found:
    """The results of all cells; those with the same policies have the same ones."""
    names, first = found.names, _first_of_twins(sweep)
    return found._replace(
        lines=[
            dict(line) | {"row": name, "cell": name}
            for name, of in zip(names, first, strict=True)
            for line in found.lines
            if line["row"] == names[of]
        ],
        curves=[
            dataclasses.replace(curve, cell=cell)
            for cell, of in enumerate(first)
            for curve in found.curves
            if curve.cell == of
        ],
    )


TABLE = Table(
    "sweep",
    columns=lambda lines: _COLUMNS,
    text=lambda found: markdown(found.lines, _sections(found)),
    figure=lambda found: learning_curves(found.names, found.curves) if found.curves else None,
    configs=lambda config, sweep: [cell.config for cell in sweep.cells],
    plan=_plan,
    policy=_policy,
    save=_write_cells,
    names=lambda sweep: [cell.name for cell in sweep.cells],
    complete=_with_twins,
    one_set=False,
)
