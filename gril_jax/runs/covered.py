"""Digests of a run's files: what a command reads is what the run wrote.

phases.json, which has a digest of itself, holds the SHA-256 of the files of each phase from the
moment at which the phase has finished, and says how far metrics.jsonl had come (see
`gril_jax.runs.metric_rows`). A command checks the files that it reads, and no others.

Not covered: what a phase has written that is still going on, but for its checkpoints; what is drawn
from other files, such as report.html; and times.jsonl.
"""

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path

from gril_jax.errors import RunError

from .phases import read_phases


def digest(file: Path) -> str:
    """The SHA-256 of a file's contents, in hexadecimal."""
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def digests(folder: Path, files: Iterable[Path]) -> dict[str, str]:
    """The digest of each of these files of a run, by its path in the folder."""
    return {file.relative_to(folder).as_posix(): digest(file) for file in files}


def known(folder: Path) -> dict[str, str]:
    """The digests that a run has noted of its files, by path."""
    by_phase = read_phases(folder).files
    return {name: value for files in by_phase.values() for name, value in files.items()}


def require_unchanged(folder: Path, *names: str) -> None:
    """Raises a RunError that names the first of these files which is not as the run wrote it."""
    noted = known(folder)
    _require(folder, {name: noted[name] for name in names if name in noted})


def require_part(folder: Path, part: str) -> None:
    """`require_unchanged` for all files that are noted below a folder of the run."""
    found = known(folder).items()
    _require(folder, {name: value for name, value in found if name.startswith(f"{part}/")})


def require_same_demos(folder: Path, header: Path) -> None:
    """Raises a RunError if a run began with another demonstration set than that of this header.

    A set outside of the run's folder may be gone.
    """
    require_unchanged(folder, "demos/demos.json")
    begun = read_phases(folder).finished.get("demos", {})
    if "sha256" in begun and header.is_file() and digest(header) != begun["sha256"]:
        raise RunError(
            f"the demonstration set {header.parent} has been changed since the run in {folder} "
            f"began, as its {header.name} shows"
        )


def _require(folder: Path, wanted: Mapping[str, str]) -> None:
    for name, value in wanted.items():
        file = folder / name
        try:
            same = digest(file) == value
        except FileNotFoundError:
            raise RunError(f"{file} is missing, but the run had written it") from None
        except OSError as error:
            raise RunError(f"{file} cannot be read ({error.strerror})") from None
        if not same:
            raise RunError(f"{file} has been changed since the run wrote it")
