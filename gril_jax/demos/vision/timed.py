"""Films by their time stamps: how long they are, and their pictures at equal steps of time.

A telephone's film has no constant frame rate, may be turned, and is large: only the pictures that
are kept are ever held, and those are made smaller.
"""

import itertools
import os
import pathlib
from collections.abc import Sequence

import av
import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from gril_jax.demos.boxes.record import Film
from gril_jax.errors import DemoError

from .video import opened

_WIDEST = 640  # pixels of a kept picture: boxes are not read from it
_LONGEST = 3600.0  # seconds


def look(path: str | os.PathLike) -> Film:
    """A film's times and size, without reading its pictures; errors are those of `read_video`."""
    path = pathlib.Path(path)
    with opened(path) as container:
        stream = container.streams.video[0]
        first = next(container.decode(stream), None)
        if first is None:
            raise DemoError(f"{path}: the video holds no frames.")
        width, height = first.width, first.height
        if round(first.rotation / 90) % 2:
            width, height = height, width
        rate = float(stream.average_rate or 0)
    with opened(path) as container:
        stream = container.streams.video[0]
        packets = [p for p in container.demux(stream) if p.size and not p.is_discard]
        stamps = [p.pts for p in packets]
        base = float(stream.time_base or 0)
    if None in stamps or len({*stamps}) < len(stamps):  # no time stamps: the header's rate
        if not rate:
            raise DemoError(f"{path}: the video states neither frame rate nor time stamps.")
        times = np.arange(len(stamps)) / rate
    else:
        times = np.sort(np.array(stamps, float)) * base
    if len(times) < 2:
        raise DemoError(f"{path}: holds {len(times)} frame, but a demonstration needs at least 2.")
    if times[-1] - times[0] > _LONGEST:
        raise DemoError(f"{path}: lasts {times[-1] - times[0]:.0f} s, but an hour is the most.")
    return Film(path, (times - times[0]).tolist(), width, height)


def steps(times: Sequence[float], fps: float) -> Float[np.ndarray, "K"]:
    """Equal steps of time from a film's first frame to its last.

    >>> steps([0.0, 0.1, 0.35], 10.0).round(1).tolist()
    [0.0, 0.1, 0.2, 0.3]
    """
    return np.arange(int((times[-1] - times[0]) * fps + 1e-3) + 1) / fps


def nearest(times: Sequence[float], at: Float[np.ndarray, "K"]) -> Int[np.ndarray, "K"]:
    """The index of the time nearest to each moment; of two the earlier.

    >>> nearest([0.0, 0.1, 0.35], np.array([0.0, 0.2, 0.3])).tolist()
    [0, 1, 2]
    """
    known = np.asarray(times)
    after = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
    return np.where(at - known[after - 1] <= known[after] - at + 1e-9, after - 1, after)


def pictures(film: Film, fps: float) -> UInt8[np.ndarray, "K H W 3"]:
    """A film's pictures at equal steps of time, turned as they are shown, at most 640 wide and with
    even sides; a DemoError if the film ends before its header says so."""
    wanted = nearest(film.times, steps(film.times, fps))
    width = min(film.width, _WIDEST) // 2 * 2
    height = max(2, round(film.height * width / film.width / 2) * 2)
    if width < 2:
        raise DemoError(f"{film.path}: is {film.width} pixels wide, but 2 are the least.")
    kept, last, count = {}, set(wanted.tolist()), 0
    with opened(film.path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        for count, frame in zip(itertools.count(1), container.decode(stream), strict=False):
            if count - 1 in last:
                kept[count - 1] = _shown(frame, width, height)
    if count < len(film.times):
        raise DemoError(
            f"{film.path}: only {count} of {len(film.times)} frames could be read; the file is cut "
            "short or damaged."
        )
    return np.stack([kept[index] for index in wanted.tolist()])


def _shown(frame: av.VideoFrame, width: int, height: int) -> UInt8[np.ndarray, "H W 3"]:
    picture = np.rot90(frame.to_ndarray(format="rgb24"), round(frame.rotation / 90))
    if picture.shape[:2] == (height, width):
        return np.ascontiguousarray(picture)
    return cv2.resize(np.ascontiguousarray(picture), (width, height), interpolation=cv2.INTER_AREA)
