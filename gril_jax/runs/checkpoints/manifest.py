"""manifest.json: what a checkpoint holds, and which checkpoints a folder has; without JAX."""

import json
import re
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.runs.phases import with_digest

FILE = "manifest.json"


class DamagedError(RunError):
    """A file of a checkpoint is missing or has changed since it was written."""


def manifest(path: Path) -> dict[str, Any]:
    """A checkpoint's step and leaves, without reading the arrays; a RunError if there is none, a
    DamagedError if it has changed."""
    try:
        text = (path / FILE).read_text(encoding="utf-8")
        content = json.loads(text)
        del content["sha256"]
        same = text == with_digest(content)
    except FileNotFoundError:
        raise RunError(f"{path} is not a complete checkpoint: it has no {FILE}") from None
    except (OSError, ValueError, KeyError, AttributeError, TypeError, RecursionError):
        raise DamagedError(f"checkpoint {path} is damaged: its manifest cannot be read") from None
    if not same:
        raise DamagedError(f"checkpoint {path} is damaged: its manifest has changed")
    return content


def steps(folder: Path) -> list[int]:
    """The steps of the complete checkpoints in a folder, oldest first."""
    if not folder.is_dir():
        return []
    found = (p for p in folder.iterdir() if re.fullmatch(r"\d{12}", p.name))
    return sorted(int(p.name) for p in found if (p / FILE).is_file())


def latest(folder: Path) -> Path | None:
    """The newest complete checkpoint in a folder, or None if there is none."""
    found = steps(folder)
    return folder / f"{found[-1]:012d}" if found else None
