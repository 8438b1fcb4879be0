"""Label Studio's JSON of videos: a list of tasks, with a `videorectangle` an object.

A rectangle has key frames, which count from 1 and are in per cent of the picture. From one to the
next it moves in a line, if it is `enabled`; after the last one it stays. A video's task is the one
whose video has its name, or the only one. Of its annotations the finished one counts, not those
that were skipped, nor drafts. Rectangles that are turned count by their upright box.

Label Studio may count frames at another rate than the video's. `framesCount` and `duration` tell.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.errors import DemoError

from .names import best, stem
from .record import Box, Film, box, checked, field, load, number, whole

_PLACES = ("x", "y", "width", "height")
_OTHERS = ("polygon", "brush", "mask", "ellipse", "keypoint", "vector")  # in a type's name
_OFF = 2  # frames that players count more or less of one video
_LENGTHS = 0.1  # share by which the lengths of one video may differ, and seconds


class _Key(NamedTuple):
    """A rectangle in a frame that a person drew it in, or hid it."""

    frame: int  # of Label Studio's count, from 0
    edges: list[float]
    enabled: bool
    where: str


def read(path: Path, film: Film) -> list[Box]:
    """The boxes of a file."""
    tasks = load(path)
    task, number_ = _task(tasks, path, film)
    where = f"{path}, task {number_}"
    found: list[Box] = []
    for n, result in enumerate(_results(task, where)):
        at = f"{where}, result {n}"
        kind = field(result, "type", str, at, "")
        if any(other in kind for other in _OTHERS):
            raise DemoError(f"{at}: a {kind[:60]} is in a box's place; draw video rectangles.")
        if kind == "videorectangle":
            found += _boxes(result, film, at)
    return checked(found, path, film)


def _task(tasks: list[Any], path: Path, film: Film) -> tuple[Any, int]:
    """The task of a video, and its place."""
    names = []
    for n, task in enumerate(tasks):
        if not isinstance(task, dict) or "data" not in task:
            raise DemoError(
                f"{path}, task {n}: has no data, so it is not of Label Studio's JSON; export that, "
                "and not JSON-MIN, or COCO with its images and categories."
            )
        data = field(task, "data", dict, f"{path}, task {n}")
        names.append([value for value in data.values() if isinstance(value, str)])
    found = best(film.path, names)
    if len(found) > 1:  # one that nobody has annotated says nothing
        found = [n for n in found if tasks[n].get("annotations")] or found[:1]
    if len(found) > 1:
        raise DemoError(
            f"{path}: tasks {found[0]} and {found[1]} are both of {film.path.name}; keep one."
        )
    if found:
        return tasks[found[0]], found[0]
    if len(tasks) == 1:
        return tasks[0], 0
    listed = ", ".join(stem(value) for values in names for value in values)[:200] or "none"
    raise DemoError(f"{path}: no task is of {film.path.name}; their videos are {listed}.")


def _results(task: Any, where: str) -> list[Any]:
    """The results of the annotation that counts: the ground truth, or the finished one."""
    made = field(task, "annotations", list, where)
    if not made:
        raise DemoError(f"{where}: nobody has annotated it yet (drafts do not count: submit them).")
    done = []
    for n, one in enumerate(made):
        at = f"{where}, annotation {n}"
        if not (isinstance(one, dict) and one.get("was_cancelled")):
            done.append((field(one, "result", list, at), bool(one.get("ground_truth"))))
    if not done:
        raise DemoError(f"{where}: nobody has annotated it yet; all annotations are skipped ones.")
    best_ = [results for results, truth in done if truth] or [results for results, _ in done]
    full = [results for results in best_ if results] or best_[:1]
    if any(results != full[0] for results in full[1:]):
        raise DemoError(
            f"{where}: {len(full)} finished annotations differ; mark one of them as ground truth, "
            "or delete the others."
        )
    return full[0]


def _boxes(result: Any, film: Film, where: str) -> Iterator[Box]:
    value = field(result, "value", dict, where)
    labels = field(value, "labels", list, where)
    if len(labels) != 1:
        raise DemoError(f"{where}: a rectangle needs one label, not {len(labels)}.")
    keys = []
    clock, total = _clock(value, film, where)
    for n, key in enumerate(field(value, "sequence", list, where)):
        at = f"{where}, key {n}"
        frame = whole(field(key, "frame", int | float, at), "frame", at, least=1) - 1
        if frame >= total:
            raise DemoError(
                f"{at}: frame {frame + 1} is beyond {film.name}, whose {total} frames count from 1."
            )
        place = [number(field(key, name, int | float, at), name, at) for name in _PLACES]
        edges = _upright(place, key.get("rotation", 0), film, at)
        keys.append(_Key(frame, edges, bool(key.get("enabled", True)), at))
    keys.sort(key=lambda key: key.frame)
    at = -1
    for now, moment in enumerate(clock):
        while at + 1 < len(keys) and keys[at + 1].frame <= moment:
            at += 1
        if at < 0 or not (keys[at].enabled or moment < keys[at].frame + 1):
            continue
        one, after = keys[at], keys[min(at + 1, len(keys) - 1)]
        share = (moment - one.frame) / max(after.frame - one.frame, 1) if one.enabled else 0.0
        edges = [a + share * (b - a) for a, b in zip(one.edges, after.edges, strict=True)]
        yield box(film, now, labels[0], edges, one.where, track=result.get("id"),
                  drawn=True)  # fmt: skip


def _clock(value: Any, film: Film, where: str) -> tuple[Sequence[float], int]:
    """Each frame of the video in Label Studio's count from 0, and how many it counts."""
    frames = len(film.times)
    count = field(value, "framesCount", int, where, None)
    if count is None or abs(count - frames) <= _OFF:
        return [*map(float, range(frames))], max(frames, count or 0)
    seconds = field(value, "duration", int | float, where, None)
    true = film.times[-1] - film.times[0] + 1 / film.fps
    if count < 1 or seconds is None or abs(seconds - true) > _LENGTHS * max(true, 1.0):
        told = "" if seconds is None else f" in {seconds:g} s"
        raise DemoError(
            f"{where}: framesCount is {count}{told}, but {film.path.name} has {frames} frames in "
            f"{true:.3g} s; the annotation must be of this very video."
        )
    rate = count / seconds
    return [round((time - film.times[0]) * rate, 6) for time in film.times], count


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
