"""`gril sweep`: many policies at once."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.config.grid import Cell, cells, take_axes
from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.runs.cluster import cluster_of

from .. import help_page, own_tasks
from ..arguments import Work
from ..words import in_full, positional, require_left_to_options, run_config, take, whole_number
from . import Verb
from .tables import made, not_beside

_ABOUT = (
    "Train every combination of the values given. An option whose value has commas is an axis: "
    "--reward learned,environmental --lambda 0.1,1."
)
_OWN = {
    "--seeds N": "Seeds of each combination, of which each is one observation. (default: 5)",
    "--rows A,B": "Rows of gril table1, as one more axis.",
    "--distributed": "One sweep of all processes of a SLURM or Kubernetes job.",
}
_PROG = "gril sweep"


def _plan(args: list[str]) -> Work:
    cluster, resume = _job(args), take(args, "--resume")
    if resume is not None:
        return _resume(Path(resume), args, cluster)
    name, seeds = positional(args), whole_number(args, "--seeds", 5)
    rows = take(args, "--rows")
    args[:] = in_full(args)
    beside = _cells_of_rows(rows, args) if rows is not None else list
    axes = take_axes(args)
    config = run_config(name, args, _PROG, _ABOUT, help_page.SWEEP, own=_OWN)

    def one(options: list[str]) -> RunConfig:  # a set may be a value of an axis
        return run_config(name, options, _PROG, _ABOUT)

    found = beside(cells(axes, args, one))

    def settings():
        from gril_jax.workflows.study.sweeps.sweep import Sweep

        return Sweep(found, seeds)

    return made("sweep", config, settings, cluster=cluster)


def _cells_of_rows(names: str, args: list[str]) -> Callable[[list[Cell]], list[Cell]]:
    """Makes of cells as many for each of these rows of Table I."""
    from gril_jax.workflows.study.rows import changed, chosen_rows
    from gril_jax.workflows.study.table1 import rows as table1_rows

    rows = chosen_rows(names, table1_rows.ROWS)
    require_left_to_options(args, table1_rows.paths(rows))

    def each(found: list[Cell]) -> list[Cell]:
        table1_rows.check(found[0].config)
        return [
            Cell((("row", name), *cell.labels), changed(cell.config, change))
            for name, change in rows.items()
            for cell in found
        ]

    return each


def _job(args: list[str]) -> dict[str, Any] | None:
    """Takes --distributed off; what connects the processes of the job, if it was there."""
    if "--distributed" not in args:
        return None
    args.remove("--distributed")
    return cluster_of(os.environ)


def _resume(folder: Path, args: list[str], cluster: dict[str, Any] | None) -> Work:
    task = take(args, "--task")
    not_beside(args, "--resume", f"its options from {folder}")
    if cluster is None:
        config = run_dir.require_resumable(folder, "sweep")
    else:  # processes that look at the same time are in each other's way: the first one will
        config = run_dir.read_config(folder)
    own_tasks.of_run(config, task, folder)
    if not (folder / "sweep.json").is_file():
        raise RunError(f"{folder} is not a sweep: it has no sweep.json")

    def read():
        from gril_jax.workflows.study.sweeps.sweep import read_cells

        return read_cells(folder)

    return made("sweep", config, read, folder, cluster=cluster)


VERBS = (
    Verb(
        "sweep [CONFIG] --seeds N",
        "every combination of options with commas, over seeds; --distributed on several hosts",
        _plan,
    ),
)
