"""The times of a video's frames, from time stamps that may repeat, miss or be useless.

Stamps are read without decoding pictures where they are in order. Else every frame is decoded to
see which there are, since some of a file's packets give none:

- A cut without re-encoding leaves pictures at the beginning that need one that is gone.
- VP8 keeps pictures that are never shown.
"""

import bisect
import itertools
import pathlib
from collections.abc import Sequence
from typing import NamedTuple

import av
import numpy as np

from gril_jax.errors import DemoError

from .opening import moving, opened

_GOOD = 0.9  # share of the stamps that must be right if the others are to be put between them
_RATES = (0.1, 1000.0)  # frames a second that a header may say


class Packet(NamedTuple):
    """One coded picture, in the order of the file."""

    pts: int | None
    dts: int | None
    key: bool


class Times(NamedTuple):
    """Seconds of each frame, and a sentence if the file does not simply say them."""

    seconds: list[float]
    note: str | None = None


def frame_times(path: pathlib.Path, first: int | None) -> Times:
    """The times of a video's frames, of which the first has the time stamp `first`.

    Raises DemoError if frames give no picture that do not come before the first whole one."""
    with opened(path) as (container, stream):
        packets = [
            Packet(one.pts, one.dts, one.is_keyframe)
            for one in container.demux(stream)
            if one.size and not one.is_discard and not _never_shown(stream, one)
        ]
        several = len(moving(container))
        base, rate = stream.time_base, float(stream.average_rate or stream.guessed_rate or 0)
    lost = 0
    if _in_order(packets, first):
        stamps = sorted(one.pts for one in packets)
    else:
        with opened(path) as (container, stream):
            stream.thread_type = "AUTO"
            stamps = [frame.pts for frame in container.decode(stream)]
        lost = _lost(path, packets, stamps)
    whole, bad = in_order(stamps)
    said = []
    if several > 1:
        said.append(f"the file holds {several} videos, of which the first counts")
    if lost:
        said.append(
            f"before its first whole picture {lost} cannot be decoded and are passed over, as in "
            "players; boxes count from the first that is shown"
        )
    wrong = f"time stamps are wrong or missing at {bad} of {len(stamps)} frames"
    if whole is not None:
        if bad:
            said.append(f"{wrong}, which were put between their neighbours")
        return Times([stamp * float(base or 0) for stamp in whole], "; ".join(said) or None)
    if not _RATES[0] <= rate <= _RATES[1]:
        raise DemoError(
            f"{path}: {wrong}, and the file says no frame rate; write it again at a constant rate."
        )
    said.append(f"{wrong}, so the file's constant rate of {rate:.4g} frames a second counts")
    return Times([number / rate for number in range(len(stamps))], "; ".join(said))


def in_order(stamps: Sequence[int | None]) -> tuple[list[float] | None, int]:
    """Increasing stamps, of which wrong ones lie between their neighbours, and how many are wrong.

    None in place of the stamps if too many are. The longest increasing series of them is right.

    >>> in_order([0, 4, 4, 12, None, 20])[0] is None
    True
    >>> in_order([*range(20), 19, 22])
    ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0, \
17.0, 18.0, 19.0, 20.5, 22.0], 1)
    """
    good = _longest_increasing(stamps)
    bad = len(stamps) - len(good)
    if not bad:
        return [*map(float, stamps)], 0
    if len(good) < max(2, _GOOD * len(stamps)):
        return None, bad
    known = np.array([stamps[at] for at in good], float)
    step = float(np.median(np.diff(known) / np.diff(good)))
    every = np.arange(len(stamps))
    found = np.interp(every, good, known)
    found += np.minimum(every - good[0], 0) * step + np.maximum(every - good[-1], 0) * step
    return found.tolist(), bad


def _longest_increasing(stamps: Sequence[int | None]) -> list[int]:
    """The places of the longest series of stamps that increase, of equal ones the first."""
    ends: list[int] = []  # the least stamp that ends a series of each length
    places: list[int] = []
    before: dict[int, int | None] = {}
    for at, stamp in enumerate(stamps):
        if stamp is None:
            continue
        length = bisect.bisect_left(ends, stamp)
        if length < len(ends) and ends[length] == stamp:
            continue
        before[at] = places[length - 1] if length else None
        ends[length : length + 1], places[length : length + 1] = [stamp], [at]
    found, at = [], places[-1] if places else None
    while at is not None:
        found.append(at)
        at = before[at]
    return found[::-1]


def _in_order(packets: Sequence[Packet], first: int | None) -> bool:
    """True if the packets alone say when each frame is shown."""
    shown = [one.pts for one in packets]
    decoded = [one.dts for one in packets if one.dts is not None]
    return (
        None not in shown
        and len({*shown}) == len(shown)
        and first == min(shown, default=None)
        and all(a <= b for a, b in itertools.pairwise(decoded))
    )


def _lost(path: pathlib.Path, packets: list[Packet], stamps: Sequence[int | None]) -> int:
    """The packets that gave no frame, which must lie before the first whole picture."""
    lost = len(packets) - len(stamps)
    begin = next((at for at, one in enumerate(packets) if one.key), 0)
    early = packets[:begin] + packets[begin + 1 : _trailing(packets, begin)]
    missing = {one.pts for one in packets} - {*stamps}
    known = None not in [one.pts for one in packets] and None not in stamps
    if lost > len(early) or (known and not missing <= {one.pts for one in early}):
        raise DemoError(
            f"{path}: {len(stamps)} of {len(packets)} frames could be read; the file is cut short "
            "or damaged."
        )
    return max(lost, 0)


def _trailing(packets: Sequence[Packet], key: int) -> int:
    """The place of the first packet after a key frame that is shown later than it.

    Those between are shown before the key frame, and may be made from what was before it."""
    shown = packets[key].pts if packets else None
    for at in range(key + 1, len(packets)):
        if shown is not None and packets[at].pts is not None and packets[at].pts > shown:
            return at
    return key + 1


def _never_shown(stream: av.VideoStream, packet: av.Packet) -> bool:
    """True for a picture of VP8 that others are made from but nobody sees."""
    return stream.codec_context.name == "vp8" and not bytes(packet)[0] >> 4 & 1
