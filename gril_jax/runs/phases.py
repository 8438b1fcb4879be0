"""phases.json: a run's original configuration, and its finished phases with their results.

{"experiment": "train", "config": "env:\\n ...", "finished": {"demos": {...}}, "sha256": "..."}
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
from gril_jax.safe_files import read_object, write_whole, writing

from .metric_rows import plain

_FILE = "phases.json"
_INSTEAD = {"table1": "its page is report.html, its table table1.md"} | {
    name: f"it has no page, but the table {name}.md and the figure {name}.png"
    for name in ("table2", "soundness", "ablate", "sweep")
}


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


def made_by(folder: Path) -> str | None:
    """The experiment that made a run's folder, such as `train`; None if it is not recorded."""
    file = folder / _FILE
    try:
        experiment = read_object(file)["experiment"]
    except FileNotFoundError:
        return None
    except KeyError:
        raise RunError(f"{file} does not say which experiment made the run") from None
    if experiment is not None and not isinstance(experiment, str):
        raise RunError(f"{file}: experiment must be a name, not {experiment!r:.40}")
    return experiment


def require_single(folder: Path) -> None:
    """Raises a RunError that says where its results lie if a run has not one reward and policy."""
    experiment = made_by(folder)
    if experiment not in (None, "train", "pretrain"):
        instead = _INSTEAD.get(experiment, "its results lie there in files of their own")
        raise RunError(f"{folder} holds a run of gril {experiment}, not of one policy: {instead}")


def changed_fields(began: str | RunConfig, now: RunConfig) -> list[str]:
    """The changed fields of a configuration, such as `run.seed (0, not 1)`; those that the YAML of
    the older one lacks are newer, and do not count."""
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
