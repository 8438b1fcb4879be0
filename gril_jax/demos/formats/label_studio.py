"""Label Studio's JSON of videos: a list of tasks, with a `videorectangle` an object.

A rectangle has key frames, which count from 1 and are in per cent of the picture. From one to the
next it moves in a line, if it is `enabled`; after the last one it stays. A video's task is the one
whose video has its name, or the only one. Rectangles that are turned count by their upright box.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gril_jax.errors import DemoError

from .record import Box, Film, box, checked, field, load, number, stem, whole

_PLACES = ("x", "y", "width", "height")


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    tasks = load(path)
    task, number_ = _task(tasks, path, film)
    found: list[Box] = []
    made = field(task, "annotations", list, f"{path}, task {number_}")
    if not made:
        raise DemoError(f"{path}, task {number_}: nobody has annotated it yet.")
    results = field(made[0], "result", list, f"{path}, task {number_}")
    for n, result in enumerate(results):
        where = f"{path}, task {number_}, result {n}"
        if field(result, "type", str, where, "") == "videorectangle":
            found += _boxes(result, film, where)
    return checked(found, path, film)


def _task(tasks: list[Any], path: Path, film: Film) -> tuple[Any, int]:
    names = []
    for n, task in enumerate(tasks):
        data = field(task, "data", dict, f"{path}, task {n}")
        films = [stem(value) for value in data.values() if isinstance(value, str)]
        # An upload's name has a digest before it: 3f2a91bc-kitchen_01.mp4
        if any(name == film.path.stem or name.endswith(f"-{film.path.stem}") for name in films):
            return task, n
        names += films
    if len(tasks) == 1:
        return tasks[0], 0
    listed = ", ".join(names)[:200] or "none"
    raise DemoError(f"{path}: no task is of {film.path.name}; their videos are {listed}.")


def _boxes(result: Any, film: Film, where: str) -> Iterator[Box]:
    value = field(result, "value", dict, where)
    labels = field(value, "labels", list, where)
    if len(labels) != 1:
        raise DemoError(f"{where}: a rectangle needs one label, not {len(labels)}.")
    keys = []
    for n, key in enumerate(field(value, "sequence", list, where)):
        at = f"{where}, key {n}"
        frame = whole(field(key, "frame", int, at), "frame", at, least=1) - 1
        place = [number(field(key, name, int | float, at), name, at) for name in _PLACES]
        keys.append((frame, _upright(place, key.get("rotation", 0), film, at),
                     bool(key.get("enabled", True)), at))  # fmt: skip
    keys.sort(key=lambda key: key[0])
    for one, after in zip(keys, [*keys[1:], None], strict=True):
        frame, edges, enabled, at = one
        last = len(film.times) if after is None and enabled else frame + 1
        last = after[0] if after is not None and enabled else last
        for now in range(frame, max(last, frame + 1)):
            share = 0.0 if after is None else (now - frame) / max(after[0] - frame, 1)
            to = edges if after is None else after[1]
            there = [a + share * (b - a) for a, b in zip(edges, to, strict=True)]
            yield box(film, now, labels[0], there, at, track=result.get("id"))


def _upright(place: list[float], rotation: Any, film: Film, where: str) -> list[float]:
    """Edges in pixels of a rectangle in per cent, turned about its upper left corner."""
    x, y, width, height = (
        share / 100 * side for share, side in zip(place, 2 * (film.width, film.height), strict=True)
    )
    angle = math.radians(number(rotation, "rotation", where))
    along = (width * math.cos(angle), width * math.sin(angle))
    down = (-height * math.sin(angle), height * math.cos(angle))
    xs = [x, x + along[0], x + down[0], x + along[0] + down[0]]
    ys = [y, y + along[1], y + down[1], y + along[1] + down[1]]
    return [min(xs), min(ys), max(xs), max(ys)]
