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
            return place, _names(place)
    return None, []


def _names(file: Path) -> list[str]:
    found: dict[str, int] = {}
    for number, line in enumerate(read_text(file).splitlines(), 1):
        if not line.strip():
            continue
        name = class_name(line, f"{file}, line {number}")
        if name in found:
            raise DemoError(
                f"{file}, line {number}: {name!r} stands in line {found[name]}, too, but each "
                "class needs a name of its own."
            )
        found[name] = number
    return [*found]


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
