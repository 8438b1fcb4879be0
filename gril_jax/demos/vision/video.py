"""Reads and writes H.264 video files.

A frame is (H, W, 3) RGB, 8 bits a channel. Files are written as yuv420p, which every browser
plays, at a quality where the codec moves a block's edge by a fraction of a pixel.
"""

import itertools
import os
import pathlib
from collections.abc import Iterable
from fractions import Fraction

import av
import cv2
import numpy as np
from jaxtyping import UInt8

from gril_jax.errors import DemoError
from gril_jax.safe_files import cause

from .opening import opened, pixel_aspect, shown
from .stamps import frame_times

_OPTIONS = {
    "crf": "12",  # constant quality: 0 is lossless, 23 is what videos use
    "preset": "veryfast",  # as exact as "medium" at this quality, half of the time, 5 % more bytes
    "x264-params": "mbtree=0",  # with it, equal small frames now and then give other bytes
}


def write_video(
    path: str | os.PathLike,
    frames: Iterable[UInt8[np.ndarray, "H W 3"]],
    fps: float,
) -> None:
    """Writes frames of one size, with even sides, as H.264 in MP4.

    The file appears complete or not at all, in a folder that exists, in place of an older one.

    Raises:
      DemoError: no frames, a frame of another or an odd size, or the file cannot be written.
    """
    path = pathlib.Path(path)
    if not fps > 0:
        raise DemoError(f"{path}: a video needs a frame rate above 0, not {fps}.")
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        _encode(part, path, frames, fps)
        os.replace(part, path)
    except OSError as error:  # av's errors are OSErrors where the system has a number for them
        raise DemoError(
            f"{path}: the video could not be written because {cause(error)}."
        ) from error
    except av.FFmpegError as error:
        raise DemoError(f"{path}: the encoder refused the frames ({error.strerror}).") from error
    finally:
        part.unlink(missing_ok=True)


def _encode(part: pathlib.Path, path: pathlib.Path, frames: Iterable, fps: float) -> None:
    frames = iter(frames)
    first = next(frames, None)
    if first is None:
        raise DemoError(f"{path}: a video needs at least 1 frame, got none.")
    height, width, _ = first.shape
    if height % 2 or width % 2 or not height or not width:
        raise DemoError(
            f"{path}: frames are {width} x {height}, but yuv420p video needs even sizes."
        )
    rate = Fraction(fps).limit_denominator(1001)
    # Our own file object: the operating system's errors (disk full) then keep their number.
    with open(part, "wb") as file, av.open(file, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=rate, options=_OPTIONS)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for index, frame in enumerate(itertools.chain([first], frames)):
            if frame.shape != first.shape:
                raise DemoError(
                    f"{path}: frame {index} has shape {frame.shape}, frame 0 {first.shape}; "
                    "all frames of a video need one size."
                )
            image = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
            container.mux(stream.encode(image))
        container.mux(stream.encode())


def read_video(path: str | os.PathLike) -> UInt8[np.ndarray, "T H W 3"]:
    """All frames of a video file, in any usual format, in display order and as shown: turned, and
    with square pixels.

    A DemoError says if the file is missing, empty, damaged, cut short, no video, or too large for
    the memory."""
    path, frames, first, aspect = pathlib.Path(path), [], None, 1.0
    with opened(path) as (container, stream):
        stream.thread_type = "AUTO"
        for frame in container.decode(stream):
            if 2 * (len(frames) + 1) * frame.width * frame.height * 3 > _memory():  # stacked below
                raise DemoError(
                    f"{path}: its frames need more than half of this machine's memory; "
                    "make the video smaller or shorter."
                )
            if not frames:
                first, aspect = frame.pts, pixel_aspect(path, stream, frame)
            frames.append(shown(path, frame))
        promised = stream.frames
    if not frames:
        raise DemoError(f"{path}: the video holds no frames.")
    if len(frames) != promised:  # the header counts what is never shown, or says nothing
        promised = len(frame_times(path, first).seconds)
    if len(frames) < promised:
        raise DemoError(
            f"{path}: only {len(frames)} of {promised} frames could be read; "
            "the file is cut short or damaged."
        )
    if any(frame.shape != frames[0].shape for frame in frames):
        raise DemoError(f"{path}: the frame size changes within the video; it must be constant.")
    if aspect != 1:
        size = round(frames[0].shape[1] * aspect), frames[0].shape[0]
        frames = [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in frames]
    return np.stack(frames)


def read_fps(path: str | os.PathLike) -> float:
    """Frames per second of a video file, from its header; errors are those of `read_video`."""
    with opened(pathlib.Path(path)) as (_, stream):
        rate = stream.average_rate
    if not rate:
        raise DemoError(f"{path}: the video states no frame rate.")
    return float(rate)


def _memory() -> int:
    """Bytes of memory that the machine has."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
