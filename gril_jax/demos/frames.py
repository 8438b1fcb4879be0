"""Frames of demonstrations as small squares, for encoders of pixels."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from gril_jax.errors import DemoError
from gril_jax.types import VideoBatch

from .demo_set import DemoSet, padded


def frame_batch(
    demo_set: DemoSet, names: Sequence[str], *, pixels: int, half_extent: float | None = None
) -> VideoBatch:
    """The frames of some demonstrations as small squares, padded as `demo_batch` pads their boxes.

    They show the world as far as `half_extent`, or the set's own. One video at a time is decoded; a
    DemoError if it is damaged, not square, or not as long as its boxes.
    """
    zoom = 1.0 if half_extent is None else half_extent / demo_set.half_extent
    videos = []
    for demo in demo_set.select(names):
        frames = demo.frames
        height, width = frames.shape[1:3]
        if height != width:
            raise DemoError(
                f"{demo_set.where}, {demo.name!r}: frames are {width} x {height}, but must be "
                "square."
            )
        videos.append(shrink(frames, pixels, zoom=zoom))
    return VideoBatch(padded(videos), np.array([len(frames) for frames in videos], np.int32))


def shrink(
    frames: UInt8[np.ndarray, "T S S 3"], pixels: int, *, zoom: float = 1.0
) -> UInt8[np.ndarray, "T P P 3"]:
    """Frames resized by area, of which a square of `zoom` times their side is shown: above 1 the
    outermost pixels go on."""
    margin = round((zoom - 1.0) * frames.shape[1] / 2)
    if margin < 0:
        frames = frames[:, -margin:margin, -margin:margin]
    border = (max(margin, 0),) * 4
    wider = (cv2.copyMakeBorder(frame, *border, cv2.BORDER_REPLICATE) for frame in frames)
    size = (pixels, pixels)
    return np.stack([cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in wider])
