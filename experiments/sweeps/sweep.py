"""Every combination of some options with several seeds, in as few compiled programs as possible.

    gril sweep quickstart --seeds 8 --reward learned,environmental --lambda 0.1,1
    gril sweep match_regions --rows "environmental,XIRL" --ppo.learning-rate 3e-4,7e-4
    gril sweep --resume RUN

Seeds and traced values are mapped in one program, static ones make programs of their own. Writes
`sweep.md` (mean, interquartile mean and its interval), `sweep.csv`, `sweep.png`, the final
policies, and one configuration a cell, which `gril train RUN/cells/000.yaml` runs by itself.
"""

import dataclasses
import functools
import io
import json
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path

import jax
from gril_jax.experiments.pipeline import demonstrations, setup

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.config.files import load, to_yaml
from gril_jax.config.grid import Cell, with_seed
from gril_jax.errors import RunError
from gril_jax.report import sweep_table
from gril_jax.report.sweep_figure import write_figure
from gril_jax.runs import hosts, run_dir
from gril_jax.runs.progress import Progress

from . import programs as sweep_programs
from . import rewards as sweep_rewards
from .rows import Row
from .training import learn_policies

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

    Of several processes (`gril_jax.runs.hosts`) the first alone keeps what it writes, and speaks.

    Raises:
      ConfigError: a cell does not fit into memory, or cannot be shared out over the devices.
      DemoError: the demonstrations do not serve the task.
    """
    every = [
        Row(i, k, with_seed(cell.config, k)) for i, cell in enumerate(cells) for k in range(seeds)
    ]
    same: dict[RunConfig, list[Row]] = {}
    for row in every:
        same.setdefault(_what_counts(row.config), []).append(row)
    rows = [twins[0] for twins in same.values()]
    classes = len(setup.make_env(config.env, training=False).classes)
    plan = sweep_programs.programs(rows, classes, jax.devices())  # refuses what cannot run
    opened = {"device": setup.device_in_words(), "experiment": "sweep"}
    with hosts.scratch() as scratch:
        shown = None
        if scratch is not None:
            own = dataclasses.replace(config.run, out=str(scratch / "run"), sinks=())
            config, resume = dataclasses.replace(config, run=own), None
            echo, shown = _say_nothing, io.StringIO()
        with (
            run_dir.create_or_resume(config, resume, **opened) as run,
            Progress(stream=shown) as progress,
        ):
            if resume is None:
                _write_cells(run.path, cells, seeds)
            echo(f"writing to {run.path}: {len(rows)} policies in {len(plan)} programs")
            table = _train(rows, plan, cells, same, run, progress, echo)
            run.finish({"policies": len(rows), "programs": len(plan)})
    echo(table)
    echo(f"written to {run.path}")
    return run.path


def _say_nothing(line: str) -> None:
    del line


def _train(rows, plan, cells, same, run: run_dir.RunDir, progress: Progress, echo: Echo) -> str:
    """All rewards and programs, in the order in which they are compiled; returns the table."""
    finished = hosts.largest([run.finished_phase(program.name) is not None for program in plan])
    left = [program for program, done in zip(plan, finished, strict=True) if not done]
    rewards: dict[Hashable, sweep_rewards.LearnedReward] = {}

    def train(program, compiled):
        done = learn_policies(program, compiled, rewards, run, progress, echo)
        run.finish_phase(program.name, done)
        if hosts.is_first():
            _write_tables(run, plan, cells, same)

    with ahead.compiling() as pool:
        wanted = sweep_rewards.get_ready(rows, _gatherer(run, progress), pool)
        ready = sweep_programs.get_ready(left, jax.devices(), pool)
        needs = functools.partial(sweep_rewards.needed, wanted)
        ahead.carry_out(
            sweep_rewards.tasks(wanted, rewards, run, progress, echo)
            + sweep_programs.tasks(left, ready, needs, train)
        )
    return _write_tables(run, plan, cells, same) if hosts.is_first() else ""


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


def _what_counts(config: RunConfig) -> RunConfig:
    """The configuration without what its policy does not depend on: such runs are made once."""
    if config.run.reward != "environmental":
        return config
    usual = RunConfig()
    unused = {name: getattr(usual, name) for name in ("demos", "encoder", "loss", "pretrain")}
    return dataclasses.replace(config, **unused)


def _write_tables(run: run_dir.RunDir, plan, cells: Sequence[Cell], same) -> str:
    """Tables and figure of what has finished so far; returns the table."""
    found = []
    metrics = run_dir.read_metrics(run.path)
    for program in plan:
        done = run.finished_phase(program.name)
        if done is not None:
            curve = [row for row in metrics if row["phase"] == program.name]
            found += sweep_table.results(done["rows"], done["taus"], curve)
    twins = {(rows[0].cell, rows[0].seed): rows for rows in same.values()}
    found = [
        dataclasses.replace(result, cell=row.cell)
        for result in found
        for row in twins[result.cell, result.seed]
    ]
    names = [cell.name for cell in cells]
    table = sweep_table.markdown(names, found)
    with run_dir.writing(run.path):
        (run.path / "sweep.md").write_text(table + "\n", encoding="utf-8")
        (run.path / "sweep.csv").write_text(sweep_table.csv(names, found), encoding="utf-8")
        write_figure(run.path / "sweep.png", names, found)
    return table
