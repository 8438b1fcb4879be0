"""CVAT for video 1.1: XML with a `<track label>` an object and a `<box frame>` a frame.

CVAT writes a box for every frame, interpolated between those that a person drew; `outside="1"`
means that it cannot be seen. Of a file with key frames alone, boxes lie on lines between them. A
project's file has the tracks of several tasks, each of one video; a video's are those of the task
of its name. CVAT numbers the frames of a subset's tasks on end. A document type is refused: with
it, a few lines of XML could name other files, or unpack to more than fits into memory.
"""

import math
import re
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from gril_jax.errors import DemoError

from .clock import require_all_seen
from .key_frames import Key, between
from .names import best
from .record import Box, Film, box, checked, number, read_text, whole

_EDGES = ("xtl", "ytl", "xbr", "ybr")
_SHAPES = ("polygon", "polyline", "points", "mask", "ellipse", "cuboid", "skeleton")
_ABOUT = (  # of a task
    "id", "name", "source", "subset", "size", "start_frame", "stop_frame", "frame_filter"
)  # fmt: skip


class _Seen(NamedTuple):
    """One box of a file."""

    track: dict[str, str]
    fields: dict[str, str]
    where: str


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    text = read_text(path)
    reader = _Reader(path)
    try:
        reader.parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise DemoError(
            f"{path}, line {error.lineno}: not whole XML ({expat.ErrorString(error.code)})."
        ) from None
    if not reader.annotations:
        raise DemoError(f"{path}, line 1: XML without <annotations> is not of CVAT for video.")
    own = _task(reader, path, film)
    for side, task, said, where in reader.sizes:
        if task in (None, own):
            _require_size(film, side, said, where)
    if own is not None:
        _require_length(film, reader.tasks[own], path)
    several = len(reader.tasks) > 1
    seen = [one for one in reader.boxes if not several or _task_of(one, reader.tasks) == own]
    before = _before(reader, path)[own] if reader.project and several else 0
    boxes = [_box(film, one, before) for one in seen]
    if own is not None:
        _require_steps(boxes, reader.tasks[own], path)
    if own is None or _last(reader.tasks[own], path) < len(film.times) - 1:
        require_all_seen(path, film, boxes)
    tracks: dict[int, list[Key]] = {}
    for one, each in zip(seen, boxes, strict=True):
        tracks.setdefault(id(one.track), []).append(Key(each.frame, each))
    for one in reader.hidden:
        frame = whole(one.fields.get("frame"), "frame", one.where, least=0) - before
        tracks.setdefault(id(one.track), []).append(Key(frame, None))
    return checked(boxes + between(film, [*tracks.values()]), path, film)


def _task(reader: "_Reader", path: Path, film: Film) -> int | None:
    """The place of the video's task; None where the file names none."""
    tasks = reader.tasks
    if len(tasks) < 2:
        return 0 if tasks else None
    sources = [[task[key] for key in ("source",) if key in task] for task in tasks]
    names = [[task[key] for key in ("name",) if key in task] for task in tasks]
    found = best(film.path, sources) or best(film.path, names)
    if not found:
        listed = ", ".join(task.get("source") or task.get("name", "?") for task in tasks)[:200]
        raise DemoError(f"{path}: no task is of {film.path.name}; their videos are {listed}.")
    if len(found) > 1:  # of one video's tasks the names may tell which is meant
        named = [n for n in best(film.path, names) if n in found]
        if len(named) != 1:
            raise DemoError(
                f"{path}: {len(found)} tasks are of {film.path.name}; export the one that counts."
            )
        found = named
    return found[0]


def _task_of(one: _Seen, tasks: list[dict[str, str]]) -> int:
    """The place of a track's task: that of its task_id, or else of its source or name."""
    ident = one.track.get("task_id")
    if ident is None:
        said = {one.track[key] for key in ("source", "task") if key in one.track}
        found = [n for n, task in enumerate(tasks) if said & {task.get("source"), task.get("name")}]
    else:
        found = [n for n, task in enumerate(tasks) if task.get("id") == ident]
    if len(found) != 1:
        raise DemoError(
            f"{one.where}: there are {len(tasks)} tasks, but task_id {ident!r:.60} of the track is "
            "none of them; export each task by itself."
        )
    return found[0]


def _require_size(film: Film, side: str, said: str, where: str) -> None:
    true, pixels = getattr(film, side), whole(said, side, where, least=1)
    if pixels != true:
        raise DemoError(
            f"{where}: the {side} is {pixels}, but {film.path.name} is {film.width} x "
            f"{film.height} pixels."
        )


def _require_length(film: Film, task: dict[str, str], path: Path) -> None:
    """Raises DemoError if the task's last frame is beyond the video, whose rate then differs."""
    total, last = len(film.times), _last(task, path)
    if last > total + 1:  # CVAT may count a damaged frame at the end
        raise DemoError(
            f"{path}: the task's last frame is {last}, but {film.path.name} has {total} frames; "
            "the boxes must be of this very file."
        )


def _last(task: dict[str, str], path: Path) -> int:
    """The last frame of a task; -1 where it is not known."""
    if task.get("stop_frame"):
        return whole(task["stop_frame"], "stop_frame", str(path), least=0)
    if task.get("size") and not task.get("frame_filter"):
        return whole(task["size"], "size", str(path), least=0) - 1
    return -1


def _require_steps(boxes: list[Box], task: dict[str, str], path: Path) -> None:
    """Raises DemoError if a task of every so many frames, or of a part, has boxes of others."""
    first, step = _first_and_step(task, path)
    if early := [one for one in boxes if one.frame < first]:
        raise DemoError(
            f"{early[0].where}: a box of frame {early[0].frame}, but the task begins at frame "
            f"{first}; frames must be numbered as in the video."
        )
    if step > 1 and (wrong := [one for one in boxes if (one.frame - first) % step]):
        raise DemoError(
            f"{wrong[0].where}: a box of frame {wrong[0].frame}, but the task has one frame in "
            f"{step} from {first} on; frames must be numbered as in the video."
        )


def _first_and_step(task: dict[str, str], path: Path) -> tuple[int, int]:
    found = re.fullmatch(r"step\s*=\s*(\d{1,6})", task.get("frame_filter", "").strip())
    first = whole(task.get("start_frame") or 0, "start_frame", str(path), least=0)
    return first, int(found[1]) if found else 1


def _before(reader: "_Reader", path: Path) -> list[int]:
    """The number that each task of a project adds to its frames: those of the subset's tasks before
    it. All are 0 where a box has a smaller number, so that each task counts by itself."""
    added, total, subset = [], 0, None
    for task in reader.tasks:
        if task.get("subset") != subset:
            total, subset = 0, task.get("subset")
        added.append(total)
        first, step = _first_and_step(task, path)
        total += first + step * whole(task.get("size") or 0, "size", str(path), least=0)
    for one in reader.boxes + reader.hidden:
        frame = whole(one.fields.get("frame", 0), "frame", one.where, least=0)
        if frame < added[_task_of(one, reader.tasks)]:
            return [0] * len(added)
    return added


def _box(film: Film, one: _Seen, before: int) -> Box:
    fields, where = one.fields, one.where
    if lacks := [key for key in ("frame", *_EDGES) if key not in fields]:
        raise DemoError(f"{where}: the box has no {lacks[0]!r}.")
    frame = whole(fields["frame"], "frame", where, least=0) - before
    edges = _upright([number(fields[key], key, where) for key in _EDGES],
                     number(fields.get("rotation", 0), "rotation", where))  # fmt: skip
    label, track = one.track.get("label"), one.track.get("id")
    drawn = one.track.get("source", "manual") == "manual"  # and not by a detector
    return box(film, frame, label, edges, where, track=track, drawn=drawn)


def _upright(edges: list[float], rotation: float) -> list[float]:
    """Edges of the upright box around one that is turned about its middle, by degrees."""
    if rotation == 0:
        return edges
    low_x, low_y, high_x, high_y = edges
    across, along = abs(math.cos(math.radians(rotation))), abs(math.sin(math.radians(rotation)))
    half = (high_x - low_x) / 2, (high_y - low_y) / 2
    wide, high = half[0] * across + half[1] * along, half[0] * along + half[1] * across
    x, y = (low_x + high_x) / 2, (low_y + high_y) / 2
    return [x - wide, y - high, x + wide, y + high]


class _Reader:
    """Collects tasks and boxes while expat goes through a file."""

    def __init__(self, path: Path):
        self.path = path
        self.boxes: list[_Seen] = []
        self.hidden: list[_Seen] = []  # at a frame where an object goes out of sight
        self.tasks: list[dict[str, str]] = []
        self.sizes: list[tuple[str, int | None, str, str]] = []  # side, task, text, where
        self.annotations = self.project = False
        self.track: dict[str, str] | None = None
        self.inside: list[str] = []
        self.text = ""
        self.parser = expat.ParserCreate("utf-8")  # whatever the file says: it is text by now
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._said
        self.parser.StartDoctypeDeclHandler = self._refuse

    @property
    def where(self) -> str:
        """The file and the line that is being read."""
        return f"{self.path}, line {self.parser.CurrentLineNumber}"

    def _refuse(self, *_: object) -> None:
        raise DemoError(f"{self.where}: a document type is not allowed; CVAT writes none.")

    def _start(self, name: str, fields: dict[str, str]) -> None:
        self.inside.append(name)
        self.text = ""
        self.annotations |= name == "annotations"
        self.project |= name == "project"
        if len(self.inside) > 100:
            raise DemoError(f"{self.where}: elements are nested too deeply for CVAT's.")
        if name == "image":
            raise DemoError(
                f"{self.where}: <image> is of CVAT for images; export the task as CVAT for video."
            )
        if name in ("task", "job"):
            self.tasks.append({})
        if name == "track":
            self.track = fields
        drawn = self.track is not None and fields.get("outside", "0") != "1"
        if name in _SHAPES and drawn:
            raise DemoError(
                f"{self.where}: a <{name}> of {self.track.get('label')!r:.60} is in a box's place; "
                "draw rectangles."
            )
        if name == "box" and self.track is not None:
            (self.boxes if drawn else self.hidden).append(_Seen(self.track, fields, self.where))

    def _said(self, text: str) -> None:
        if "meta" in self.inside or self.inside[-2:-1] == ["original_size"]:
            self.text += text

    def _end(self, name: str) -> None:
        self.inside.pop()
        if self.inside[-1:] in (["task"], ["job"]) and name in _ABOUT:
            self.tasks[-1].setdefault(name, self.text.strip())
        if self.inside[-1:] == ["original_size"] and name in ("width", "height"):
            # Of a file without tasks, the size is that of its one video.
            task = len(self.tasks) - 1 if {"task", "job"} & {*self.inside} else None
            self.sizes.append((name, task, self.text, self.where))
        if name == "track":
            self.track = None
