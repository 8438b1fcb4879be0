"""Names as tools write them: of classes, of videos among several, and of files beside them.

Names are compared in one Unicode form, NFC: a Mac writes an umlaut in two letters, others in one.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from gril_jax.demos.folders import composed
from gril_jax.errors import DemoError, is_printable

_LONGEST = 60  # letters of a class name
_JOINERS = "\u200c\u200d"  # which show nothing
_UPLOAD = re.compile(r"[0-9a-f]{8}-")  # what Label Studio puts before an uploaded file's name


def class_name(value: Any, where: str) -> str:
    """A class name: printable text without spaces around it; joiners may stand inside a word."""
    name = composed(" ".join(value.split())) if isinstance(value, str) else ""
    name = name.strip(_JOINERS)
    if not name or len(name) > _LONGEST or not is_printable(name):
        raise DemoError(
            f"{where}: a class must be a name of up to {_LONGEST} printable letters, not "
            f"{value!r:.60}."
        )
    return name


def stem(name: str) -> str:
    """The stem of a file's name or address in a tool's own storage.

    >>> stem("/data/upload/7/kitchen_01.mp4")
    'kitchen_01'
    """
    return base(name).rsplit(".", 1)[0]


def base(name: str) -> str:
    """The last part of a file's name or address in a tool's own storage, in one Unicode form.

    >>> base("/data/local-files/?d=a.mp4"), base("s3://me/K%C3%BCche.mp4?key=a/b")
    ('a.mp4', 'Küche.mp4')
    """
    name = name.split("?d=", 1)[-1].split("?", 1)[0]
    if "://" in name or name.startswith("/data/"):  # an address, not a path
        name = unquote(name)
    return composed(name.replace("\\", "/").rsplit("/", 1)[-1])


def best(film: Path, named: Sequence[Iterable[str]]) -> list[int]:
    """Places of those that are of a video by their names: the ones whose name fits best.

    The whole name goes before the name without its ending, and both before the name that a file
    has once it is uploaded: 3f2a91bc-kitchen_01.mp4, with underscores in place of spaces.

    >>> best(Path("a.mp4"), [["kitchen-a.mp4"], ["s3://me/a.mov"], ["0a1b2c3d-a.mp4"]])
    [1]
    """
    whole, short = composed(film.name), composed(film.stem)
    kept = re.sub(r"[^-\w.]", "", short.replace(" ", "_"))
    fits = (
        lambda name: base(name) == whole,
        lambda name: short in (stem(name), base(name)),
        lambda name: _UPLOAD.sub("", stem(name), count=1) in (short, kept),
    )
    for fit in fits:
        if found := [n for n, names in enumerate(named) if any(map(fit, names))]:
            return found
    return []


def there(path: Path) -> Path:
    """The path, or the one beside it whose name differs in its Unicode form, or else in capitals
    alone, as on a Mac's or Windows' disk."""
    if path.exists() or path.is_symlink() or not path.parent.is_dir():
        return path
    beside = sorted(path.parent.iterdir())
    for form in (composed, folded):
        name = form(path.name)
        if found := next((one for one in beside if form(one.name) == name), None):
            return found
    return path


def folded(name: str) -> str:
    """A name without regard to its Unicode form and to capitals."""
    return composed(composed(name).casefold())
