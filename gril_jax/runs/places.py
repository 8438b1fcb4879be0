"""Where the demonstrations, the reward and the task's file are now that a run names.

A configuration has their paths as the user gave them. So that a run works from any directory, and
moves with or without them, times.jsonl notes the run's folder and the working directory at the
beginning. A thing is then looked for as the path says, from the working directory of now and of
then, beside the run as it lay then, and in the folder that holds the run. JAX is not imported here.
"""

import contextlib
import dataclasses
import os
from collections.abc import Callable
from pathlib import Path

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.safe_files import digest

from .json_lines import read_times

_HEADER = "demos.json"


def here(folder: Path) -> dict[str, str]:
    """The line of times.jsonl that says where a run begins."""
    return {"folder": os.path.abspath(folder), "working_directory": os.getcwd()}


def candidates(folder: Path, path: str) -> list[Path]:
    """The places at which a thing that a run names may be, the likeliest first; none is checked.

    The first is where it was when the run began, if the run notes that.
    """
    noted = _noted(folder)
    found = [Path(path)]
    if noted is not None:
        began, directory = noted
        absolute = os.path.normpath(os.path.join(directory, path))
        if absolute != os.path.abspath(path):
            found.insert(0, Path(absolute))
        beside = os.path.relpath(absolute, began)
        found.append(Path(os.path.normpath(os.path.join(os.path.abspath(folder), beside))))
    found.append(Path(os.path.abspath(folder)).parent / Path(path).name)
    return [*dict.fromkeys(found)]


def find(folder: Path, path: str, fits: Callable[[Path], bool]) -> Path | None:
    """The first of the `candidates` that fits; None if none does."""
    return next((place for place in candidates(folder, path) if fits(place)), None)


def with_demos(config: RunConfig, folder: Path, sha256: str | None) -> RunConfig:
    """The configuration with the place at which its demonstration set is now.

    It is the one whose header has the digest, if that is known. If none has it, the place is the
    set's first one, where there is nothing, or what has been changed.
    """
    path = config.demos.path
    if path is None:
        return config

    def fits(place: Path) -> bool:
        header = place / _HEADER
        return header.is_file() and sha256 in (None, digest(header))

    found = find(folder, path, fits) or candidates(folder, path)[0]
    return at(config, found)


def at(config: RunConfig, demos: Path) -> RunConfig:
    """The configuration with its demonstration set at a place."""
    return dataclasses.replace(config, demos=dataclasses.replace(config.demos, path=str(demos)))


def require(demos: Path, purpose: str) -> None:
    """Raises RunError unless a demonstration set is here, which is needed for the purpose."""
    if not (demos / _HEADER).is_file():
        raise RunError(
            f"the demonstration set {demos} is gone, but {purpose}: if it lies elsewhere now, say "
            "where with --demos"
        )


def _noted(folder: Path) -> tuple[str, str] | None:
    """The run's folder and the working directory when it began; None if nothing says so."""
    with contextlib.suppress(RunError):
        for line in read_times(folder):
            began, directory = line.get("folder"), line.get("working_directory")
            if isinstance(began, str) and isinstance(directory, str):
                return began, directory
    return None
