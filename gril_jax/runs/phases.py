"""phases.json: a run's original configuration, and its finished phases with their results.

    {"experiment": "train", "config": "env:\\n ...", "finished": {"demos": {...}}, "sha256": "..."}

JAX is not imported here.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from gril_jax.config import RunConfig
from gril_jax.config.files import to_yaml
from gril_jax.errors import RunError
from gril_jax.safe_files import write_whole, writing

from .metric_rows import plain

_FILE = "phases.json"


@dataclass(frozen=True)
class Phases:
    """The contents of phases.json."""

    experiment: str | None  # the experiment that can go on with the run, None if it cannot
    config: str  # YAML, as the run began
    finished: dict[str, dict[str, Any]] = field(default_factory=dict)  # phase to its results


def write_phases(folder: Path, phases: Phases) -> None:
    """Replaces the file atomically; results are numbers, strings and lists of them."""
    with writing(folder):
        text = with_digest(plain(dataclasses.asdict(phases)))
        write_whole(folder / _FILE, text + "\n")


def read_phases(folder: Path) -> Phases:
    """The phases that `write_phases` wrote; a `RunError` if the file is missing or has changed."""
    file = folder / _FILE
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if content.pop("sha256") == json_digest(content):
            return Phases(**content)
    except FileNotFoundError:
        raise RunError(
            f"{folder} cannot be resumed, because it has no {_FILE}: it is of an older version"
        ) from None
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        pass
    raise RunError(f"{folder} cannot be resumed, because its {_FILE} has changed")


def changed_fields(began: str | RunConfig, now: RunConfig) -> list[str]:
    """The changed fields of a configuration, such as `run.seed (0, not 1)`.

    Args:
      began: as it was; fields that its YAML lacks are newer, and do not count.
      now: as it is.
    """
    before = yaml.safe_load(began if isinstance(began, str) else to_yaml(began))
    after = yaml.safe_load(to_yaml(now))
    return [
        f"{section}.{name} ({after[section].get(name)!r}, not {value!r})"
        for section, fields in before.items()
        for name, value in fields.items()
        if after.get(section, {}).get(name) != value
    ]


def with_digest(content: Mapping[str, Any]) -> str:
    """A JSON object as text, with its digest as another field."""
    return json.dumps({**content, "sha256": json_digest(content)}, indent=1)


def json_digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of a JSON object with its fields in order, in hexadecimal."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
