"""The boxes file beside a film, and its format, which is told from what is in it.

Beside NAME.mp4 the boxes are NAME.csv, NAME.txt, NAME.xml, NAME.json, or a folder NAME.
"""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from gril_jax.errors import DemoError

from . import csv_rows
from .record import Box, Film, read_text

FORMATS: tuple[ModuleType, ...] = (csv_rows,)
_SUFFIXES = (".csv", ".txt", ".xml", ".json")
_HEAD = 4096  # letters from which a format is told


def boxes_of(film: Film) -> list[Box]:
    """The boxes beside a film; a DemoError if there are none, or their format is not known."""
    path = file_of(film.path)
    return reader(path)(path, film)


def file_of(film: Path) -> Path:
    """The file or folder of a film's boxes."""
    beside = [film.with_suffix(suffix) for suffix in _SUFFIXES]
    found = [path for path in (*beside, film.with_suffix("")) if path.exists()]
    if not found:
        listed = ", ".join(path.name for path in beside)
        raise DemoError(f"{film}: no boxes are beside the film; name them {listed}.")
    if len(found) > 1:
        raise DemoError(f"{film}: both {found[0].name} and {found[1].name} are beside the film.")
    return found[0]


def reader(path: Path) -> Callable[[Path, Film], list[Box]]:
    """The reader of a file's format."""
    head = read_text(path)[:_HEAD]
    for form in FORMATS:
        if form.recognised(head):
            return form.read
    raise DemoError(
        f"{path}, line 1: the format of the boxes is not known; a CSV file begins with "
        f"{','.join(csv_rows.COLUMNS)}."
    )
