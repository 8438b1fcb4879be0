"""Every combination of some options with several seeds, in as few compiled programs as possible.

    gril sweep quickstart --seeds 8 --reward learned,environmental --lambda 0.1,1
    gril sweep --resume RUN

Seeds and traced values are mapped in one program, static ones make programs of their own. Writes
`sweep.md` (mean, interquartile mean and its interval), `sweep.csv`, `sweep.png`, the final
policies, and one configuration a cell, which `gril train RUN/cells/000.yaml` runs by itself.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import jax

from gril_jax import run_dir, sweep_table
from gril_jax.config import RunConfig
from gril_jax.config_files import load, to_yaml
from gril_jax.errors import RunError
from gril_jax.progress import Progress
from gril_jax.sweep_grid import Cell, with_seed
from gril_jax.sweep_plot import write_figure

from . import demonstrations, setup
from .sweep_training import Row, learn_policies, learn_rewards, programs

__all__ = ["main", "read_cells"]

Echo = Callable[[str], None]


def main(
    config: RunConfig,
    cells: Sequence[Cell],
    seeds: int,
    *,
    resume: Path | None = None,
    echo: Echo = print,
) -> Path:
    """Run the sweep, or go on with one; returns its folder.

    Raises:
      ConfigError: a cell does not fit into memory, or cannot be shared out over the devices.
      DemoError: the demonstrations do not serve the task.
    """
    rows = [
        Row(i, k, with_seed(cell.config, k)) for i, cell in enumerate(cells) for k in range(seeds)
    ]
    classes = len(setup.make_env(config.env, training=False).classes)
    plan = programs(rows, classes, jax.devices())  # refuses what cannot run
    opened = {"device": setup.device_in_words(), "experiment": "sweep"}
    with run_dir.create_or_resume(config, resume, **opened) as run, Progress() as progress:
        if resume is None:
            _write_cells(run.path, cells, seeds)
        echo(f"writing to {run.path}: {len(rows)} policies in {len(plan)} programs")
        gather = _gatherer(run, progress)
        rewards = learn_rewards(rows, gather, run, progress, echo)
        for program in plan:
            if run.finished_phase(program.name) is None:
                done = learn_policies(program, rewards, run, progress, echo, jax.devices())
                run.finish_phase(program.name, done)
            _write_tables(run, plan, cells)
        table = _write_tables(run, plan, cells)
        run.finish({"policies": len(rows), "programs": len(plan)})
    echo(table)
    echo(f"written to {run.path}")
    return run.path


def read_cells(folder: Path) -> tuple[list[Cell], int]:
    """The cells of a sweep and its number of seeds.

    Raises:
      RunError: the folder is no sweep, or its files are damaged.
    """
    try:
        about = json.loads((folder / "sweep.json").read_text(encoding="utf-8"))
        cells = [
            Cell(tuple(map(tuple, labels)), load(str(folder / "cells" / f"{i:03}.yaml")))
            for i, labels in enumerate(about["cells"])
        ]
        return cells, int(about["seeds"])
    except (OSError, ValueError, KeyError, TypeError):
        raise RunError(f"{folder} is not a sweep: its sweep.json is missing or damaged") from None


def _write_cells(folder: Path, cells: Sequence[Cell], seeds: int) -> None:
    with run_dir.writing(folder):
        (folder / "cells").mkdir()
        for i, cell in enumerate(cells):
            (folder / "cells" / f"{i:03}.yaml").write_text(to_yaml(cell.config), encoding="utf-8")
        about = {"seeds": seeds, "cells": [cell.labels for cell in cells]}
        (folder / "sweep.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")


def _gatherer(run: run_dir.RunDir, progress: Progress):
    """Demonstrations for a configuration, each set made once."""
    made: dict[tuple, demonstrations.Demonstrations] = {}

    def gather(config: RunConfig) -> demonstrations.Demonstrations:
        key = (config.env, config.demos)
        if key not in made:
            env = setup.make_env(config.env, training=False)
            folder = run.path / ("demos" if not made else f"demos-{len(made)}")
            made[key] = demonstrations.gather(config, env, folder, progress)
        return made[key]

    return gather


def _write_tables(run: run_dir.RunDir, plan, cells: Sequence[Cell]) -> str:
    """Tables and figure of what has finished so far; returns the table."""
    found = []
    metrics = run_dir.read_metrics(run.path)
    for program in plan:
        done = run.finished_phase(program.name)
        if done is not None:
            curve = [row for row in metrics if row["phase"] == program.name]
            found += sweep_table.results(done["rows"], done["taus"], curve)
    names = [cell.name for cell in cells]
    table = sweep_table.markdown(names, found)
    with run_dir.writing(run.path):
        (run.path / "sweep.md").write_text(table + "\n", encoding="utf-8")
        (run.path / "sweep.csv").write_text(sweep_table.csv(names, found), encoding="utf-8")
        write_figure(run.path / "sweep.png", names, found)
    return table
