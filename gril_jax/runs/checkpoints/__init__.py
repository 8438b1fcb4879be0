"""Checkpoints of a run, written completely or not at all; what a folder has, without JAX."""

import re
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.lazy import offer
from gril_jax.runs.json_lines import without_digest

__all__, __getattr__ = offer(
    __name__,
    checkpoint="CheckpointWriter discard keep_newest newest restore save save_arrays save_part",
)

FILE = "manifest.json"


class DamagedError(RunError):
    """A file of a checkpoint is missing or has changed since it was written."""


def manifest(path: Path) -> dict[str, Any]:
    """A checkpoint's step and leaves, without reading the arrays; a RunError if there is none, a
    DamagedError if it has changed."""
    try:
        content = without_digest((path / FILE).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RunError(f"{path} is not a complete checkpoint: it has no {FILE}") from None
    except (OSError, ValueError):
        raise DamagedError(f"checkpoint {path} is damaged: its manifest cannot be read") from None
    if content is None:
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
