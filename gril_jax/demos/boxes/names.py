"""The names file of a format that numbers its classes: one name a line."""

from pathlib import Path

from gril_jax.errors import DemoError

from .record import class_name, read_text

FILES = ("names.txt", "classes.txt", "labels.txt", "obj.names")


def names_beside(path: Path, film: Path) -> tuple[Path | None, list[str]]:
    """The names file of a film, and its names: NAME.names, or one of `FILES` beside the boxes or
    the film; nothing where there is none."""
    folders = dict.fromkeys((path if path.is_dir() else path.parent, film.parent))
    places = [film.with_suffix(".names"), *(folder / name for folder in folders for name in FILES)]
    for place in places:
        if place.is_file() and place != path:
            lines = enumerate(read_text(place).splitlines(), 1)
            return place, [class_name(x, f"{place}, line {n}") for n, x in lines if x.strip()]
    return None, []


def named(number: int, first: int, names: list[str], file: Path | None, where: str) -> str:
    """The name of a numbered class, of which the first has the number `first`."""
    if file is None:
        raise DemoError(
            f"{where}: class {number} is a number, but no names are beside the film: write "
            f"{FILES[0]} there, a name a line."
        )
    if not 0 <= number - first < len(names):
        raise DemoError(
            f"{where}: class {number} is not among the {len(names)} names of {file.name}, which "
            f"are numbered from {first}."
        )
    return names[number - first]
