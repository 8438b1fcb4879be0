"""Finds boxes in videos once, and keeps them beside the videos, in the folder `detected`.

`detected/NAME.csv` has the sightings of a video in our own format, also those of low scores, and
`detected/counted/NAME.csv` those that count, to be corrected by hand.
`detected/detector.json` says by which detector, and in which videos. A second import reads them.
"""

import contextlib
import csv
import io
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gril_jax.demos.formats.record import Box, Film, box, read_text, whole
from gril_jax.demos.formats.table import COLUMNS
from gril_jax.demos.schema import digest
from gril_jax.demos.vision.timed import frames_of
from gril_jax.errors import DemoError
from gril_jax.safe_files import write_whole

from .sightings import Sighting
from .wanted import Wanted

FOLDER, HEADER, COUNTED = "detected", "detector.json", "counted"
_VERSION = 1
_HEAD = (*COLUMNS, "confidence")
_DIGITS = 2  # of a pixel
_OFTEN = 0.2  # share of a video's frames that show a class which nobody has named


class Kept:
    """The sightings of videos, found where they are not in the folder yet."""

    def __init__(self, folder: Path, asked: Wanted):
        self.folder, self.asked = folder / FOLDER, asked
        self._digests: dict[Path, str] = {}
        found = self._header()
        same = found.get("detector") == asked.detector.key
        self._videos: dict[str, Any] = found["videos"] if same else {}

    def _header(self) -> dict[str, Any]:
        """The header in the folder, {} if there is none; a DemoError if it is somebody else's."""
        try:
            found = json.loads((self.folder / HEADER).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            found = None
        if isinstance(found, dict) and isinstance(found.get("videos"), dict):
            return found if found.get("version") == _VERSION else {}
        if self.folder.exists() and (not self.folder.is_dir() or [*self.folder.iterdir()]):
            raise DemoError(
                f"{self.folder}: is where boxes that are detected are kept, but holds something "
                "else; rename it."
            )
        return {}

    def __call__(
        self, films: Sequence[Film], progress: Callable[[int, int], None]
    ) -> dict[str, list[Box]]:
        """The sightings of each video by its name; `progress` is called with the frames that are
        done and all frames."""
        total = sum(len(film.times) for film in films)
        done, found = 0, {}
        for film in films:
            path = self.folder / f"{film.name}.csv"
            if self._videos.get(film.name) == self._of(film) and path.is_file():
                found[film.name] = _read(path, film)
            else:
                rows = []
                for row in self._rows(film):
                    rows.append(row)
                    progress(done + len(rows), total)
                self._write(film, path, rows)
                found[film.name] = [*_boxes(film, rows)]
            done += len(film.times)
            progress(done, total)
        return found

    def _of(self, film: Film) -> dict[str, Any]:
        """Tells a video from one that it was before."""
        if film.path not in self._digests:
            self._digests[film.path] = digest(film.path)
        part = [film.begin, len(film.times)]
        return {"sha256": self._digests[film.path], "part": part}

    def _rows(self, film: Film) -> Iterator[list[Sighting]]:
        frames = frames_of(film)
        while batch := [*itertools.islice(frames, self.asked.detector.together)]:
            yield from self.asked.detector(np.stack(batch))

    def _write(self, film: Film, path: Path, rows: Sequence[Sequence[Sighting]]) -> None:
        """Keeps a video's sightings, unless the folder cannot be written."""
        text = _table(
            [frame, one.name, *_rounded(one), round(one.score, 4)]
            for frame, row in enumerate(rows)
            for one in row
        )
        self._videos = self._videos | {film.name: self._of(film)}
        header = {"version": _VERSION, "detector": self.asked.detector.key, "videos": self._videos}
        try:
            self.folder.mkdir(exist_ok=True)
            write_whole(path, text)
            write_whole(self.folder / HEADER, json.dumps(header, indent=1, ensure_ascii=False))
        except OSError:  # a disk to be read only, or a full one: boxes are found again next time
            with contextlib.suppress(OSError):
                path.unlink()

    def write_counted(self, counted: Mapping[str, Sequence[Box]]) -> None:
        """Writes the boxes that count of each video, unless the folder cannot be written."""
        folder = self.folder / COUNTED
        with contextlib.suppress(OSError):
            folder.mkdir(exist_ok=True)
            for name, boxes in counted.items():
                rows = ([one.frame, one.name, *one.edges, one.confidence] for one in boxes)
                write_whole(folder / f"{name}.csv", _table(rows))


def _table(rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_HEAD, *rows])
    return text.getvalue()


def _read(path: Path, film: Film) -> list[Box]:
    found = []
    for line, row in enumerate(csv.reader(read_text(path).splitlines()[1:]), 2):
        where = f"{path}, line {line}"
        if len(row) != len(_HEAD):
            raise DemoError(f"{where}: is damaged; delete {path}, and boxes are detected again.")
        frame, name, *edges, score = row
        number = whole(frame, "frame", where, least=0)
        found.append(box(film, number, name, edges, where, confidence=score))
    return found


def _rounded(one: Sighting) -> list[float]:
    return [round(edge, _DIGITS) for edge in one.edges]


def _boxes(film: Film, rows: Sequence[Sequence[Sighting]]) -> Iterator[Box]:
    for frame, row in enumerate(rows):
        for one in row:
            where = f"{film.name}, frame {frame}"
            yield Box(frame, one.name, tuple(_rounded(one)), round(one.score, 4), None, where)


def chosen(
    found: dict[str, list[Box]], films: Sequence[Film], asked: Wanted
) -> tuple[dict[str, list[Box]], list[str]]:
    """The sightings that count, by video, and the classes that were left out as rare.

    Classes that nobody has named count if a video shows them in a fifth of its frames.

    Raises:
      DemoError: nothing counts in a video, or a class that the user has named in none.
    """
    counted = {name: [*_counted(boxes, asked)] for name, boxes in found.items()}
    rare: list[str] = []
    if asked.named:
        _require_found(found, counted, asked)
    else:
        known = {one.name for boxes in counted.values() for one in boxes}
        rare = sorted(known - {*_often(counted, films)})
        counted = {
            name: [one for one in boxes if one.name not in rare] for name, boxes in counted.items()
        }
    for film in films:
        if not counted[film.name]:
            raise DemoError(
                f"{film.path}: nothing of {_listed([*asked.most])} was found in any frame with a "
                f"score of {asked.score:g} or more; lower detect_score, or leave the video out."
            )
    return counted, rare


def _counted(boxes: Sequence[Box], asked: Wanted) -> Iterator[Box]:
    """Of each frame and class the best that are asked for, with a score that is enough."""
    seen: dict[tuple[int, str], int] = {}
    for one in sorted(boxes, key=lambda one: (one.frame, -one.confidence)):
        key = one.frame, one.name
        if one.confidence < asked.score or seen.get(key, 0) >= asked.most.get(one.name, 0):
            continue
        seen[key] = seen.get(key, 0) + 1
        yield one


def _often(counted: dict[str, list[Box]], films: Sequence[Film]) -> Iterator[str]:
    for film in films:
        frames: dict[str, set[int]] = {}
        for one in counted[film.name]:
            frames.setdefault(one.name, set()).add(one.frame)
        yield from (n for n, at in frames.items() if len(at) >= _OFTEN * len(film.times))


def _require_found(
    found: dict[str, list[Box]], counted: dict[str, list[Box]], asked: Wanted
) -> None:
    known = {one.name for boxes in counted.values() for one in boxes}
    for name in asked.most:
        if name not in known:
            scores = [one.confidence for boxes in found.values() for one in boxes
                      if one.name == name]  # fmt: skip
            best = f"the best score is {max(scores):.2g}" if scores else "nothing is like it"
            raise DemoError(
                f"detect: no {name!r} is in any video with a score of {asked.score:g} or more "
                f"({best}); lower detect_score, use another word, or leave it out."
            )


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
