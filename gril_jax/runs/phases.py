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
from gril_jax.safe_files import require_regular, write_whole, writing

from .json_lines import plain

_FILE = "phases.json"
_INSTEAD = {"sweep": "its page is report.html, its table study.md"}


@dataclass(frozen=True)
class Phases:
    """The contents of phases.json."""

    experiment: str | None  # the experiment that can go on with the run, None if it cannot
    config: str  # YAML, as the run began
    finished: dict[str, dict[str, Any]] = field(default_factory=dict)  # phase to its results
    files: dict[str, dict[str, str]] = field(default_factory=dict)  # phase to digests
    metrics: dict[str, Any] | None = None  # how far metrics.jsonl is covered, as its `mark` says

    @property
    def done(self) -> bool:
        """True if the run has come to its results."""
        return "finished" in self.files


def write_phases(folder: Path, phases: Phases) -> None:
    """Replaces the file atomically; results are numbers, strings and lists of them."""
    with writing(folder):
        write_whole(folder / _FILE, with_digest(plain(dataclasses.asdict(phases))) + "\n")


def read_phases(folder: Path) -> Phases:
    """The phases that `write_phases` wrote; a `RunError` if the file is missing or has changed."""
    file = folder / _FILE
    require_regular(file)
    try:
        text = file.read_text(encoding="utf-8")
        content = json.loads(text)
        del content["sha256"]
        if text == with_digest(content) + "\n":
            return Phases(**content)
    except FileNotFoundError:
        require_run(folder)
        raise RunError(f"{file} is missing, but the run had written it") from None
    except (OSError, ValueError, KeyError, AttributeError, TypeError, RecursionError):
        pass
    raise RunError(f"{file} has been changed since the run wrote it")


def require_run(path: Path) -> None:
    """Raises a RunError if a folder is of no run."""
    if not path.is_dir():
        fault = "is a file" if path.exists() else "does not exist"
        raise RunError(f"{path} {fault}, but must be the folder of a run")
    if not (path / "config.yaml").is_file():
        raise RunError(f"{path} is not the folder of a run, because it has no config.yaml")


def require_single(folder: Path) -> None:
    """Raises a RunError that says where its results lie if a run has not one reward and policy."""
    experiment = read_phases(folder).experiment
    if experiment not in (None, "train", "pretrain"):
        instead = _INSTEAD.get(experiment, "its results lie there in files of their own")
        raise RunError(f"{folder} holds a run of gril {experiment}, not of one policy: {instead}")


def changed_fields(began: str | RunConfig, now: RunConfig) -> list[str]:
    """The changed fields of a configuration, such as `run.seed (0, not 1)`."""
    before = yaml.safe_load(began if isinstance(began, str) else to_yaml(began))
    after = yaml.safe_load(to_yaml(now))
    return [
        f"{section}.{name} ({after[section].get(name)!r}, not {value!r})"
        for section, fields in before.items()
        for name, value in fields.items()
        if after.get(section, {}).get(name) != value
    ]


def with_digest(content: Mapping[str, Any]) -> str:
    """A JSON object as text, with the SHA-256 of its sorted fields as another field."""
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return json.dumps({**content, "sha256": digest}, indent=1)
