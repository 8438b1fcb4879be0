"""The rows of a table: chosen by their names, and kept beside the run that makes them.

Neither JAX nor MuJoCo is imported here: the command line looks at the rows first.
"""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from gril_jax.config import RunConfig
from gril_jax.config.command_line import nearest
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs.phases import changed_fields
from gril_jax.safe_files import write_whole, writing

__all__ = ["Rows", "changed", "chosen_rows", "differing", "read_settings", "write_settings"]

# Name to what it changes: dotted paths of the configuration, and their values.
Rows = Mapping[str, Mapping[str, Any]]

Settings = TypeVar("Settings")


def chosen_rows(names: str | None, known: Rows) -> Rows:
    """Rows by their names with commas between; all where there is no choice.

    Raises:
      ConfigError: there is no row of this name, or one is named twice.
    """
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
    """The configuration with some fields, named by dotted paths, set to other values.

    Raises:
      ConfigError: a value is out of its field's range.
    """
    parts: dict[str, Any] = {}
    for path, value in change.items():
        section, field = path.split(".")
        part = parts.get(section, getattr(config, section))
        parts[section] = dataclasses.replace(part, **{field: value})
    return dataclasses.replace(config, **parts)


def differing(first: RunConfig, second: RunConfig, rows: Rows) -> list[str]:
    """Fields for which the rows of two runs cannot stand in one table, as `changed_fields` tells.

    Args:
      first: configuration of one run.
      second: of another; where it writes to does not count.
      rows: of both. What every one of them sets does not count either.
    """
    everywhere = set.intersection(*(set(change) for change in rows.values())) if rows else set()
    found = changed_fields(first, second)
    return [said for said in found if said.split(" ")[0] not in {"run.out", *everywhere}]


def write_settings(file: Path, settings: Any) -> None:
    """A dataclass beside the run's configuration, for `read_settings`."""
    with writing(file.parent):
        write_whole(file, json.dumps(dataclasses.asdict(settings), indent=1) + "\n")


def read_settings(file: Path, kind: type[Settings], about: str) -> Settings:
    """What `write_settings` wrote.

    Args:
      file: in a run's folder.
      kind: the dataclass.
      about: what the folder should be, in words.

    Raises:
      RunError: the file is missing or damaged.
    """
    try:
        return kind(**json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        raise RunError(
            f"{file.parent} is no {about}: its {file.name} is missing or damaged"
        ) from None
