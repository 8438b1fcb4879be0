"""Which frame of a video a number means: whether tools count from 0 or 1, or by steps.

A tool that reads every fifth frame and numbers them 1, 2, 3 leaves boxes in the first fifth of the
video. Nothing in such files says so, so they are refused: read as they are, the video would be
five times too fast.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from gril_jax.errors import DemoError

from .record import Box, Film

_LEAST = 2  # frames with boxes, from which a step can be told
_SHORT = 10  # frames of a video, in fewer of which no step is told
_MANY = 5  # boxes of a class in the only frame that has some, from which they are of all frames
_DENSE = 0.6  # share of the frames up to the last that have boxes, if all of them were looked at
_STEP = 1.9  # from here on the frames are as many as those of every second one
_NAME = 1000  # letters of a name that are looked at
_ROBOFLOW = re.compile(r"(_(jpe?g|png))?\.rf\.\w+$")  # which it writes after a file's name


def require_whole(path: Path, film: Film, frames: Iterable[int], otherwise: str) -> None:
    """Raises DemoError if boxes seem to be of every so many frames, numbered without a step.

    `frames` are those that were looked at; `otherwise` says what helps if nothing is seen later.
    """
    known, total = sorted({*frames}), len(film.times)
    if len(known) < _LEAST or total < _SHORT:
        return
    first, last = known[0], known[-1]
    step = total / (last + 1)
    if step < _STEP or len(known) < _DENSE * (last - first + 1) or 4 * first > last:
        return
    raise DemoError(
        f"{path}: all boxes lie in frames {first} to {last}, the first {1 / step:.0%} of the "
        f"{total} frames of {film.path.name}, as if they were of one frame in {step:.0f}: "
        f"number them by the video's frames, or, if nothing is seen later, {otherwise}."
    )


def require_all_seen(path: Path, film: Film, boxes: list[Box]) -> list[Box]:
    """The boxes; a DemoError if they seem to be of every so many frames, numbered without it."""
    frames = {one.frame for one in boxes}
    require_whole(path, film, frames, "cut the video there")
    most = max(Counter((one.frame, one.name) for one in boxes).values(), default=0)
    if len(frames) == 1 and most >= max(_MANY, len(film.times) / 2):
        raise DemoError(
            f"{path}: all boxes are of frame {boxes[0].frame}, {most} of {boxes[0].name!r}, but "
            f"{film.path.name} has {len(film.times)} frames: each box needs the number of its own."
        )
    return boxes


def first_of(
    numbers: Sequence[int], film: Film, what: str, where: str, usual: int | None = None
) -> int:
    """The number of a video's first frame, 0 or 1, by the numbers of some of its frames.

    From 0 if one is 0, from 1 if one is the number of frames. Between both, `usual` is taken; where
    it is None, numbers from 1 on are refused and others count from 0.
    """
    least, most, total = min(numbers, default=0), max(numbers, default=0), len(film.times)
    if least == 0 or most > total:
        return 0
    if most == total:
        return 1
    if usual is None and least == 1:
        raise DemoError(
            f"{where}: {what} goes from 1 to {most}, but {film.path.name} has {total} frames, so "
            "the first one may be 0 or 1: list all frames, or let it begin with 0."
        )
    return usual or 0


def number_in(name: str) -> int | None:
    """The number at the end of a picture's file name; None where there is none.

    >>> number_in("a/img_12.jpg"), number_in("a_mp4-0007_jpg.rf.3f2a91bc.jpg"), number_in("a.jpg")
    (12, 7, None)
    """
    digits = re.search(r"(\d+)\D*$", bare(name).rsplit("/", 1)[-1])
    return int(digits[1]) if digits and len(digits[1]) < 19 else None


def series_of(name: str) -> str:
    """A picture's file name without its number, which the pictures of one video have in common.

    >>> series_of("kitchen/a_12.jpg"), series_of("12.jpg")
    ('kitchen/a_', '')
    """
    return re.sub(r"\d+\D*$", "", bare(name))


def natural(name: str) -> list[str | int]:
    """A key that sorts names by their numbers, where they have some.

    >>> sorted(["10.jpg", "2.jpg", "1.jpg"], key=natural)
    ['1.jpg', '2.jpg', '10.jpg']
    """
    parts = re.split(r"([0-9]+)", name[:_NAME])
    return [int(part) if n % 2 else part for n, part in enumerate(parts)]


def bare(name: str) -> str:
    """A picture's file name without its ending, and without what Roboflow writes after it.

    >>> bare("a_mp4-0007_jpg.rf.3f2a91bc.txt")
    'a_mp4-0007'
    """
    stem = name.replace("\\", "/").rsplit(".", 1)[0] if "." in name else name
    return _ROBOFLOW.sub("", stem)
