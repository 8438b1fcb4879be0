"""phases.json: a run's original configuration, its finished phases, and digests of its files.

{"experiment": "train", "config": "env:\\n ...", "finished": {"demos": {...}},
 "files": {"demos": {"demos/demos.json": "..."}}, "metrics": {"lines": 9, ...}, "sha256": "..."}
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
from gril_jax.safe_files import read_object, require_regular, write_whole, writing

from .metric_rows import plain

_FILE = "phases.json"
COVERED = {"digests": _FILE}  # says in versions.json that a run must have this file
_INSTEAD = {"sweep": "its page is report.html, its table study.md"}


@dataclass(frozen=True)
class Phases:
    """The contents of phases.json."""

    experiment: str | None  # the experiment that can go on with the run, None if it cannot
    config: str  # YAML, as the run began
    finished: dict[str, dict[str, Any]] = field(default_factory=dict)  # phase to its results
    files: dict[str, dict[str, str]] | None = None  # phase to digests; None in older runs
    metrics: dict[str, Any] | None = None  # how far metrics.jsonl is covered, as its `mark` says


def write_phases(folder: Path, phases: Phases) -> None:
    """Replaces the file atomically; results are numbers, strings and lists of them."""
    with writing(folder):
        text = with_digest(plain(dataclasses.asdict(phases)))
        write_whole(folder / _FILE, text + "\n")


def read_phases(folder: Path) -> Phases:
    """The phases that `write_phases` wrote; a `RunError` if the file is missing or has changed."""
    found = recorded(folder)
    if found is None:
        raise RunError(
            f"{folder} cannot be resumed, because it has no {_FILE}: it is of an older version"
        )
    return found


def recorded(folder: Path) -> Phases | None:
    """The phases of a run; None for one so old that it has none, a `RunError` if they are damaged
    or lost."""
    file = folder / _FILE
    require_regular(file)
    try:
        text = file.read_text(encoding="utf-8")
        content = json.loads(text)
        del content["sha256"]
        if text == with_digest(content) + "\n":
            return Phases(**content)
    except FileNotFoundError:
        if _is_covered(folder):
            raise RunError(f"{file} is missing, but the run had written it") from None
        return None
    except (OSError, ValueError, KeyError, AttributeError, TypeError, RecursionError):
        pass
    raise RunError(f"{file} has been changed since the run wrote it")


def _is_covered(folder: Path) -> bool:
    """True if a run must have the file, as its versions.json says."""
    try:
        return COVERED.items() <= read_object(folder / "versions.json").items()
    except (RunError, FileNotFoundError):
        return False


def made_by(folder: Path) -> str | None:
    """The experiment that made a run's folder, such as `train`; None if it is not recorded."""
    found = recorded(folder)
    if found is not None and not isinstance(found.experiment, str | None):
        raise RunError(f"{folder / _FILE}: experiment must be a name, not {found.experiment!r:.40}")
    return found and found.experiment


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
