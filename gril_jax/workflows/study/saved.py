"""A study in the folder of its run: what it is, its rows, and which of them the folder is to make.

    study.json      the study, its rows' changes, and the work: rows with their seeds
    rows/ROW.yaml   the configuration of a row, which `gril train` takes
    parts/000/      a run of some of the rows, by a process of its own

Neither JAX nor MuJoCo is imported here.
"""

import dataclasses
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from gril_jax.config import RunConfig
from gril_jax.config.files import to_yaml
from gril_jax.config.grid import with_seed
from gril_jax.config.tables import REWARDS
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir
from gril_jax.runs.reading import require_unchanged
from gril_jax.safe_files import write_whole, writing

from .recipe import Study, changed, difference

EXPERIMENT = "sweep"  # of the run's phases: the verb that goes on with it
_FILE = "study.json"

Work = Mapping[str, Sequence[int]]  # row to places of its seeds


class Row(NamedTuple):
    """One row of a study with one of its seeds: a run."""

    cell: int  # place of the row among all of the study
    seed: int  # place of the seed among the row's
    config: RunConfig


class Plan(NamedTuple):
    """A study with its rows, and the part of it that is to be made."""

    study: Study
    config: RunConfig  # what the rows have in common
    rows: Mapping[str, RunConfig]  # all that the study has, with their first seed
    work: Work
    in_parts: bool = False  # True if runs in the folder `parts` do the work

    @property
    def runs(self) -> list[Row]:
        """The work, a run for each row and seed."""
        return [
            Row(cell, seed, with_seed(row, seed))
            for cell, (name, row) in enumerate(self.rows.items())
            for seed in self.work.get(name, ())
        ]


def learns(config: RunConfig) -> bool:
    """True if a reward is learned for the policy."""
    return REWARDS[config.run.reward_form].learns


def without_twins(rows: Mapping[str, RunConfig]) -> tuple[dict[str, RunConfig], dict[str, str]]:
    """The rows without those that repeat an earlier one, and these with its name.

    A policy that learns no reward ignores the options of learning one, so such rows may repeat."""
    usual, kept, twins = RunConfig(), {}, {}
    first: dict[RunConfig, str] = {}
    for name, config in rows.items():
        ignored = [] if learns(config) else ["encoder", "pool", "loss", "pretrain"]
        if ignored and not getattr(getattr(config, config.run.algorithm), "video_state_resets", 0):
            ignored.append("demos")
        counts = dataclasses.replace(config, **{k: getattr(usual, k) for k in ignored})
        if (same := first.setdefault(counts, name)) == name:
            kept[name] = config
        else:
            twins[name] = same
    return kept, twins


# --- files


def write(folder: Path, plan: Plan) -> list[Path]:
    """Writes study.json, for `read`, and a YAML file for each row of the work; their paths."""
    about = {
        "study": dataclasses.asdict(plan.study),
        "rows": {name: difference(plan.config, row) for name, row in plan.rows.items()},
        "work": {name: [*seeds] for name, seeds in plan.work.items()},
        "in_parts": plan.in_parts,
    }
    with writing(folder):
        write_whole(folder / _FILE, json.dumps(about, indent=1) + "\n")
    return [folder / _FILE, *write_rows(folder, plan)]


def write_rows(folder: Path, plan: Plan) -> list[Path]:
    """Writes the YAML files of the work's rows that are not there; returns their paths."""
    files = row_files(folder, [*plan.rows])
    missing = [name for name in plan.work if not files[name].exists()]
    with writing(folder):
        for name in missing:
            files[name].parent.mkdir(exist_ok=True)
            write_whole(files[name], to_yaml(plan.rows[name]))
    return [files[name] for name in missing if files[name].is_relative_to(folder)]


def read(folder: Path) -> Plan:
    """The study that `write` wrote; RunError if the folder has none, or a damaged one."""
    require_unchanged(folder, _FILE)
    config = run_dir.read_config(folder)
    try:
        about = json.loads((folder / _FILE).read_text(encoding="utf-8"))
        rows = {name: changed(config, change) for name, change in about["rows"].items()}
        return Plan(Study(**about["study"]), config, rows, about["work"], about["in_parts"])
    except (OSError, ValueError, TypeError, KeyError, AttributeError, ConfigError):
        raise RunError(f"{folder} is no study: its {_FILE} is missing or damaged") from None


def root(folder: Path) -> Path:
    """The folder of the whole study, of a part or of itself."""
    return folder.parent.parent if folder.parent.name == "parts" else folder


def parts(folder: Path) -> list[Path]:
    """The folders of a study's parts that have begun, in order."""
    return sorted(path.parent for path in folder.glob("parts/*/config.yaml"))


def left(folder: Path) -> list[Path]:
    """The parts that have not finished."""
    return [part for part in parts(folder) if not (part / "results.json").is_file()]


def row_files(folder: Path, names: Sequence[str]) -> dict[str, Path]:
    """Row to the file of its configuration, which has the row's name as far as files can."""
    found: dict[str, Path] = {}
    for place, name in enumerate(names):
        stem = re.sub(r"[^\w.+-]+", "-", name).strip("-.")[:80] or "row"
        file = root(folder) / "rows" / f"{stem}.yaml"
        while file in found.values():
            file = file.with_stem(f"{file.stem}-{place}")
        found[name] = file
    return found


def command(plan: Plan, folder: Path, name: str) -> str:
    """The command that runs a row alone."""
    verb = "train" if plan.study.policies else "pretrain"
    return f"gril {verb} {row_files(folder, [*plan.rows])[name]}"
