"""CVAT for video 1.1: XML with a `<track label>` an object and a `<box frame>` a frame.

CVAT writes a box for every frame, interpolated between those that a person drew; `outside="1"`
means that it cannot be seen. A document type is refused: with it, a few lines of XML could name
other files, or unpack to more than fits into memory.
"""

from pathlib import Path
from xml.parsers import expat

from gril_jax.errors import DemoError

from .record import Box, Film, box, checked, read_text, whole

_EDGES = ("xtl", "ytl", "xbr", "ybr")


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    text = read_text(path)
    reader = _Reader(path, film)
    try:
        reader.parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise DemoError(
            f"{path}, line {error.lineno}: not whole XML ({expat.ErrorString(error.code)})."
        ) from None
    if not reader.annotations:
        raise DemoError(f"{path}, line 1: XML without <annotations> is not of CVAT for video.")
    return checked(reader.boxes, path, film)


class _Reader:
    """Collects boxes while expat goes through a file."""

    def __init__(self, path: Path, film: Film):
        self.path, self.film, self.boxes = path, film, []
        self.annotations = False
        self.track: dict[str, str] | None = None
        self.inside: list[str] = []
        self.text = ""
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._said
        self.parser.StartDoctypeDeclHandler = self._refuse

    @property
    def where(self) -> str:
        return f"{self.path}, line {self.parser.CurrentLineNumber}"

    def _refuse(self, *_: object) -> None:
        raise DemoError(f"{self.where}: a document type is not allowed; CVAT writes none.")

    def _start(self, name: str, fields: dict[str, str]) -> None:
        self.inside.append(name)
        self.text = ""
        self.annotations |= name == "annotations"
        if len(self.inside) > 100:
            raise DemoError(f"{self.where}: elements are nested too deeply for CVAT's.")
        if name == "image":
            raise DemoError(
                f"{self.where}: <image> is of CVAT for images; export the task as CVAT for video."
            )
        if name == "track":
            self.track = fields
        if name == "box" and self.track is not None and fields.get("outside", "0") != "1":
            if lacks := [key for key in ("frame", *_EDGES) if key not in fields]:
                raise DemoError(f"{self.where}: the box has no {lacks[0]!r}.")
            frame = whole(fields["frame"], "frame", self.where, least=0)
            edges = [fields[key] for key in _EDGES]
            own = self.track.get("label"), self.track.get("id")
            self.boxes.append(box(self.film, frame, own[0], edges, self.where, track=own[1]))

    def _said(self, text: str) -> None:
        if self.inside[-2:-1] == ["original_size"]:
            self.text += text

    def _end(self, name: str) -> None:
        self.inside.pop()
        sides = {"width": self.film.width, "height": self.film.height}
        if self.inside[-1:] == ["original_size"] and name in sides:
            side = whole(self.text, name, self.where, least=1)
            if side != sides[name]:
                raise DemoError(
                    f"{self.where}: the {name} is {side}, but {self.film.path.name} is "
                    f"{self.film.width} x {self.film.height} pixels."
                )
        if name == "track":
            self.track = None
