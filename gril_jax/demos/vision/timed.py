"""Videos by their time stamps: how long they are, and their pictures at equal steps of time.

A telephone's video has no constant frame rate, may be turned, and is large. So only the pictures
that are kept are in memory, and those are made smaller.
"""

import os
import pathlib
from collections.abc import Container, Iterator, Sequence

import av
import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from gril_jax.demos.formats.record import Film
from gril_jax.errors import DemoError

from .opening import opened, pixel_aspect, shown, size_shown
from .stamps import frame_times

_WIDEST = 640  # pixels of a kept picture: boxes are not read from it
_LONGEST = 3600.0  # seconds
_FASTER = 1.01  # times its rate that a video of 29.97 frames a second may be asked for
_NEAR = 1e-3  # seconds, to which time stamps are told apart


def look(path: str | os.PathLike) -> Film:
    """A video's times and size, without reading its pictures; errors are those of `read_video`."""
    path = pathlib.Path(path)
    with opened(path) as (container, stream):
        first = next(container.decode(stream), None)
        if first is None:
            raise DemoError(f"{path}: the video holds no frames.")
        width, height = size_shown(path, first)
        aspect = pixel_aspect(path, stream, first)
    found, note = frame_times(path, first.pts)
    times = np.array(found)
    if len(times) < 2:
        raise DemoError(f"{path}: holds {len(times)} frame, but a demonstration needs at least 2.")
    if times[-1] - times[0] > _LONGEST:
        raise DemoError(f"{path}: lasts {times[-1] - times[0]:.0f} s, but an hour is the most.")
    first_s = float(times[0])
    if aspect != 1:
        said = f"pixels are {aspect:.3g} times as wide as high; boxes count the stored "
        said += f"{width} x {height}, and lengths are as they are shown"
        note = said if note is None else f"{note}; {said}"
    times_ = (times - first_s).tolist()
    return Film(path, times_, width, height, note=note, first=first_s, aspect=aspect)


def part(film: Film, begin: float, end: float, title: str) -> Film:
    """The frames of a video from one time to before another, as a video of its own; a DemoError if
    they are fewer than 2."""
    times = [t for t in film.times if begin - _NEAR <= t < end - _NEAR]
    if len(times) < 2:
        raise DemoError(f"{film.path}: {title} has {len(times)} frames, but 2 are the least.")
    return film._replace(times=[t - times[0] for t in times], begin=times[0], title=title)


def rate_of(films: Sequence[Film], most: float) -> float:
    """Frames a second of the slowest video, but no more than `most`."""
    return min(*(film.fps for film in films), most)


def required_rate(films: Sequence[Film], fps: float) -> float:
    """The frames a second that are asked for.

    Raises DemoError for more than the slowest video has: what is between its frames nobody saw."""
    slowest = min(films, key=lambda film: film.fps)
    if fps > slowest.fps * _FASTER:
        raise DemoError(
            f"{slowest.path}: fps is {fps:g}, but the video has {slowest.fps:.4g} frames a second, "
            "and a set can have no more than its slowest video."
        )
    return fps


def require_a_step(films: Sequence[Film], fps: float) -> None:
    """Raises DemoError for a video that is shorter than a step of the set."""
    for film in films:
        if len(steps(film.times, fps)) < 2:
            raise DemoError(
                f"{film.path}: {film.name} lasts {film.times[-1]:.2g} s, but must last a step of "
                f"the set at least, {1 / fps:.2g} s; leave it out."
            )


def steps(times: Sequence[float], fps: float) -> Float[np.ndarray, "K"]:
    """Equal steps of time from a video's first frame to its last.

    >>> steps([0.0, 0.1, 0.35], 10.0).round(1).tolist()
    [0.0, 0.1, 0.2, 0.3]
    """
    return np.arange(int((times[-1] - times[0]) * fps + 1e-3) + 1) / fps


def nearest(times: Sequence[float], at: Float[np.ndarray, "K"]) -> Int[np.ndarray, "K"]:
    """The index of the time nearest to each of `at`; of two the earlier.

    >>> nearest([0.0, 0.1, 0.35], np.array([0.0, 0.2, 0.3])).tolist()
    [0, 1, 2]
    """
    known = np.asarray(times)
    after = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
    return np.where(at - known[after - 1] <= known[after] - at + 1e-9, after - 1, after)


def pictures(film: Film, fps: float) -> UInt8[np.ndarray, "K H W 3"]:
    """A video's pictures at equal steps of time, at most 640 wide and with even sides; errors are
    those of `frames_of`."""
    wanted = nearest(film.times, steps(film.times, fps))
    last = {*wanted.tolist()}
    kept = {n: frame for n, frame in enumerate(frames_of(film, _WIDEST, only=last)) if n in last}
    return np.stack([kept[index] for index in wanted.tolist()])


def frames_of(
    film: Film, widest: int | None = None, *, only: Container[int] | None = None
) -> Iterator[UInt8[np.ndarray, "H W 3"]]:
    """Every frame of a video, turned as it is shown; with `widest` no wider, with even sides and
    square pixels.

    Those that are not among `only` are one pixel. A DemoError if the video ends before its header
    says so.
    """
    if widest is not None and film.width < 2:
        raise DemoError(f"{film.path}: is {film.width} pixel wide, but 2 are the least.")
    size = None
    if widest is not None:
        width = min(film.width, widest) // 2 * 2
        shown_height = film.height * width / film.width / film.aspect
        size = width, max(2, round(shown_height / 2) * 2)
    nothing, count = np.zeros((1, 1, 3), np.uint8), 0
    begin = None if film.begin is None else film.begin + film.first
    with opened(film.path) as (container, stream):
        stream.thread_type = "AUTO"
        if begin is not None:  # to the key frame before it
            container.seek(int(begin / stream.time_base), stream=stream)
        for frame in container.decode(stream):
            if begin is not None and (frame.time or 0.0) < begin - _NEAR:
                continue
            if count == len(film.times) and begin is not None:
                break
            _require_size(film, frame, count)
            yield nothing if only is not None and count not in only else _sized(film, frame, size)
            count += 1
    if count != len(film.times):
        raise DemoError(
            f"{film.path}: {count} of {len(film.times)} frames could be read; the file is cut "
            "short or damaged."
        )


def _require_size(film: Film, frame: av.VideoFrame, number: int) -> None:
    width, height = size_shown(film.path, frame)
    if (width, height) != (film.width, film.height):
        raise DemoError(
            f"{film.path}: the frame size changes within the video: frame {number} is {width} x "
            f"{height} pixels, but the first is {film.width} x {film.height}; write it in one size."
        )


def _sized(
    film: Film, frame: av.VideoFrame, size: tuple[int, int] | None
) -> UInt8[np.ndarray, "H W 3"]:
    picture = shown(film.path, frame)
    if size is None or picture.shape[1::-1] == size:
        return picture
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
