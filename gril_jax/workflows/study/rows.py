"""The rows of a table: chosen by name, and saved beside the run that makes them.

Neither JAX nor MuJoCo is imported here, nor in the rows of any table: the command line looks at
them first.
"""

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.config import RunConfig
from gril_jax.config.command_line import nearest
from gril_jax.config.grid import with_seed
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs.covered import require_unchanged
from gril_jax.runs.phases import changed_fields
from gril_jax.safe_files import write_whole, writing

# Name to what it changes: dotted paths of the configuration, and their values.
Rows = Mapping[str, Mapping[str, Any]]

# The paper's encoder, in the fields that rows of both of its tables change. GraphIRL and XIRL train
# by cycle-consistency alone.
PAPERS_OWN: dict[str, Any] = {
    "encoder.kind": "paper",
    "encoder.relations": False,
    "encoder.robot": False,
    "loss.lambda_": 1.0,
    "loss.consistency": "tcc",
    "pretrain.turn_scenes": False,
    "pretrain.random_activity": 0.0,
    "pretrain.num_perturbations": 0,
    "pretrain.adversarial_steps": 0,
}
WITH_ROBOT = {"encoder.robot": True}
GRAPHIRL = {"encoder.kind": "interaction", "loss.lambda_": 0.0}
XIRL = {"encoder.kind": "pixels", "loss.lambda_": 0.0}


class Row(NamedTuple):
    """One row of a table with one of its seeds."""

    cell: int  # place of the row among all
    seed: int  # place of the seed among the row's
    config: RunConfig


@dataclasses.dataclass(frozen=True)
class Settings:
    """All of a table that is not in its configuration; a whole number is an option of its verb."""

    rows: Rows
    seeds: int = 5
    """Encoders and policies of each row."""


@dataclasses.dataclass(frozen=True)
class AuditedSettings(Settings):
    """Those of a table whose rewards are audited."""

    ascents: int = 1000
    """Gradient ascents of an audit, shared by its starts."""
    starts: int = 4
    """Starts that an audit begins from, of each kind."""


def chosen_rows(names: str | None, known: Rows) -> Rows:
    """Rows by their comma-separated names, each once; all if `names` is None."""
    if names is None:
        return known
    wanted = [name.strip() for name in names.split(",")]
    for name in wanted:
        if name not in known:
            hint = nearest(name, [*known])
            raise ConfigError(f"--rows names {name!r}{hint}, but the rows are: {', '.join(known)}")
        if wanted.count(name) > 1:
            raise ConfigError(f"--rows names {name!r} twice, but a row is made once")
    return {name: known[name] for name in wanted}


def changed(config: RunConfig, change: Mapping[str, Any]) -> RunConfig:
    """The configuration with some fields, named by dotted paths, set to other values."""
    parts: dict[str, Any] = {}
    for path, value in change.items():
        section, field = path.split(".")
        part = parts.get(section, getattr(config, section))
        parts[section] = dataclasses.replace(part, **{field: value})
    return dataclasses.replace(config, **parts)


def require_learned(config: RunConfig) -> None:
    """Raises ConfigError if policies would not learn from the rewards that a table compares."""
    if config.run.reward != "learned":
        raise ConfigError(
            f"run.reward is {config.run.reward!r}, but must be 'learned' to compare learned rewards"
        )


def with_seeds(configs: Sequence[RunConfig], seeds: int) -> list[Row]:
    """Each row's configuration with this many seeds."""
    return [
        Row(cell, seed, with_seed(config, seed))
        for cell, config in enumerate(configs)
        for seed in range(seeds)
    ]


def differing(first: RunConfig, second: RunConfig, rows: Rows) -> list[str]:
    """Fields that keep the rows of two runs out of one table, as `changed_fields` describes them.

    Where a run writes to does not count, nor what every row sets.
    """
    everywhere = set.intersection(*(set(change) for change in rows.values())) if rows else set()
    found = changed_fields(first, second)
    return [said for said in found if said.split(" ")[0] not in {"run.out", *everywhere}]


def write_settings(folder: Path, name: str, settings: Settings) -> list[Path]:
    """Beside the run's configuration as `NAME.json`, for `read_settings`; returns its path."""
    file = folder / f"{name}.json"
    with writing(folder):
        write_whole(file, json.dumps(dataclasses.asdict(settings), indent=1) + "\n")
    return [file]


def read_settings(folder: Path, name: str, kind: type[Settings]) -> Any:
    """The settings, of this kind, that `write_settings` wrote; RunError if they are damaged."""
    require_unchanged(folder, f"{name}.json")
    try:
        found = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
        rows = {
            row: {path: tuple(x) if isinstance(x, list) else x for path, x in change.items()}
            for row, change in found["rows"].items()
        }
        return kind(**found | {"rows": rows})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        raise RunError(
            f"{folder} is no run of gril {name}: its {name}.json is missing or damaged"
        ) from None
