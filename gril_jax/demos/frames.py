"""The videos of a demo set as one array of small square frames, for encoders of pictures."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from gril_jax.demos.demo_set import DemoSet, padded
from gril_jax.demos.vision.video import read_video
from gril_jax.encoders.resnet import VideoBatch
from gril_jax.errors import DemoError


def frame_batch(
    demo_set: DemoSet, names: Sequence[str], *, pixels: int, half_extent: float | None = None
) -> VideoBatch:
    """The frames of some demonstrations, padded as `gril_jax.demos.demo_batch` pads their boxes.

    One video at a time is decoded; what is kept takes 3 bytes a pixel, on the host.

    Args:
      names: which demonstrations, in that order.
      pixels: width and height of a frame.
      half_extent: half the width of the world that a frame shall show, as of the pictures that the
        frames are to be compared with; the set's own if left out.

    Raises:
      DemoError: a name is unknown, or a video is damaged, not square, or not as long as its boxes.
    """
    known = {entry.name: entry for entry in demo_set.entries}
    zoom = 1.0 if half_extent is None else half_extent / demo_set.half_extent
    videos = []
    for name in names:
        if name not in known:
            raise DemoError(f"{demo_set.folder}: there is no demonstration {name!r}.")
        path = demo_set.folder / known[name].video
        frames = read_video(path)
        count, height, width, _ = frames.shape
        if count != known[name].frames:
            raise DemoError(
                f"{path}: holds {count} frames, but its boxes are those of {known[name].frames}."
            )
        if height != width:
            raise DemoError(f"{path}: frames are {width} x {height}, but must be square.")
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
