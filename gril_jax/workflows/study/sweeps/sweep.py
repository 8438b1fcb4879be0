"""All combinations of some options with several seeds, in as few compiled programs as possible.

    gril sweep quickstart --seeds 8 --reward learned,environmental --lambda 0.1,1
    gril sweep match_regions --rows "environmental,XIRL" --ppo.learning-rate 3e-4,7e-4

Writes `sweep.md`, `sweep.csv`, `sweep.png`, the final policies, and one configuration a cell, which
`gril train RUN/cells/000.yaml` runs by itself; at the end, or when `gril report RUN` draws a sweep
that was cut off, `report.html`. With `run.audit` each learned reward is audited.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gril_jax.config import RunConfig
from gril_jax.config.files import load, to_yaml
from gril_jax.config.grid import Cell
from gril_jax.errors import RunError
from gril_jax.report.audit import asked
from gril_jax.runs import run_dir
from gril_jax.runs.covered import require_part, require_unchanged
from gril_jax.workflows.build import setup
from gril_jax.workflows.study.curves import LAST, Curve, at_the_end, learning_curves
from gril_jax.workflows.study.measures import FIGURES, Measure, audit
from gril_jax.workflows.study.results import Found, Table
from gril_jax.workflows.study.rewards import learns, task_key
from gril_jax.workflows.study.written import markdown

from .page import SOUND, page, sections

_STARTS = 4  # that an audit is shared out among, as a run's own
_OWN = "own"  # the variant of the task that policies are trained in
_AUDIT = [f"{name}_{_OWN}" for name in FIGURES]
_COLUMNS = ("cell", "seed", *LAST, "steps_80", "tau", *_AUDIT, SOUND)


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


def _measures(config: RunConfig, sweep: Sweep, demos: Any) -> list[Measure]:
    """The audit of each learned reward, if asked for and if all cells are of one task with stages:
    rewards of several tasks are not judged by the same states."""
    del demos
    audited = [cell.config for cell in sweep.cells if learns(cell.config) and cell.config.run.audit]
    ascents = {one.run.audit for one in audited}
    if len({task_key(one) for one in audited}) != 1 or len(ascents) != 1:
        return []
    env = setup.make_env(audited[0].env, training=False)
    if getattr(env, "stages", None) is None:
        return []
    return [audit({_OWN: env}, starts=_STARTS, ascents=ascents.pop())]


def _policy(curve: Curve) -> dict[str, float | int]:
    numbers = at_the_end(curve)
    return numbers | {k: int(numbers[k]) for k in ("env_steps", "steps_80") if numbers[k] < np.inf}


def _complete(found: Found, sweep: Sweep) -> Found:
    """The results of all cells, of which those with the same policies have the same ones, and
    whether each reward is sound."""
    names, first = found.names, _first_of_twins(sweep)
    return found._replace(
        lines=[
            dict(line) | _sound(line) | {"row": name, "cell": name}
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


def _sound(line: Mapping[str, Any]) -> dict[str, float]:
    """1 if the reward keeps all bounds of an audit, 0 if not; empty if it was not audited."""
    if not any(name in line for name in _AUDIT):
        return {}
    numbers = {long: line.get(f"{name}_{_OWN}", np.nan) for name, long in FIGURES.items()}
    return {SOUND: float(not asked.faults(numbers))}


TABLE = Table(
    "sweep",
    columns=lambda lines: _COLUMNS,
    text=lambda found: markdown(found.lines, sections(found)),
    figure=lambda found: learning_curves(found.names, found.curves) if found.curves else None,
    page=page,
    configs=lambda config, sweep: [cell.config for cell in sweep.cells],
    plan=_plan,
    policy=_policy,
    measured={"audit": _AUDIT},
    measures=_measures,
    save=_write_cells,
    load=lambda folder, *_: read_cells(folder),
    names=lambda sweep: [cell.name for cell in sweep.cells],
    complete=_complete,
    one_set=False,
)
