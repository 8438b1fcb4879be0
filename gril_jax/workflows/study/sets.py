"""Demonstration sets that a study makes of films, one for each task of its rows."""

from collections.abc import Iterable
from pathlib import Path

from gril_jax.config import RunConfig
from gril_jax.demos.importing import import_videos
from gril_jax.demos.magical_pickles import HALF_EXTENT
from gril_jax.errors import DemoError

from .driver import Echo

_FOLDERS = {"match_regions_magical": "match-regions"}  # of films, where not by the task's name
_KINDS = "*.pkl.gz", "*.mp4"


def make(configs: Iterable[RunConfig], films: str | None, echo: Echo) -> None:
    """Makes the sets that are missing, from a folder with a folder of films for each task; a
    DemoError, before any is made, if films are missing."""
    sets = {c.demos.path: c.env.name for c in configs if c.demos.path is not None}
    missing = {
        Path(out): task for out, task in sets.items() if not (Path(out) / "demos.json").is_file()
    }
    found = {out: _films_of(films, task, out) for out, task in missing.items()}
    for out, task in missing.items():
        echo(f"finding the objects in the films of {found[out]}")
        out.parent.mkdir(parents=True, exist_ok=True)
        pickles = next(found[out].glob(_KINDS[0]), None) is not None
        how = {} if pickles else {"boxes": "colour", "half_extent": HALF_EXTENT}
        import_videos(found[out], out, task=task, **how)


def _films_of(films: str | None, task: str, out: Path) -> Path:
    names = dict.fromkeys([_FOLDERS.get(task, task.replace("_", "-")), task])
    for folder in (Path(films) / name for name in (names if films else ())):
        if any(next(folder.glob(kind), None) for kind in _KINDS):
            return folder
    where = f"{films} has no folder {next(iter(names))} of them" if films else "--films is missing"
    raise DemoError(f"{out} is no demonstration set, and to make it of films {where}")
