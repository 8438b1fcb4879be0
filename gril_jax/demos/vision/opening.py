"""Video files, opened, and their pictures as they are shown.

What plays other files or addresses, such as a playlist, is no video here.
"""

import contextlib
import pathlib
from collections.abc import Iterator

import av
import numpy as np
from av.sidedata.sidedata import Type
from av.stream import Disposition
from jaxtyping import UInt8

from gril_jax.errors import DemoError

from .wholeness import require_whole

_READ = {"format_whitelist": "mov,mp4,matroska,webm,avi,gif,mpegts,mpeg,ogg,flv,asf,h264,hevc,wav"}
_STILL = Disposition.attached_pic | Disposition.timed_thumbnails  # a cover, as music players show
_POINTER = b"version https://git-lfs.github.com/"
_HEAD = 256  # bytes
_OBLIQUE = 20  # times that the one pair of a turn's numbers must be larger than the other
# By degrees, counter-clockwise: rows and columns exchanged, left and right, top and bottom.
_TURNS = {0: (0, 0, 0), 90: (1, 0, 1), 180: (0, 1, 1), -180: (0, 1, 1), -90: (1, 1, 0)}

_SQUARE = 0.01  # by which encoders miss 1, where sides are rounded to blocks
_STRETCHED = 8.0  # from here on a ratio is none that is meant

Opened = tuple[av.container.InputContainer, av.VideoStream]


@contextlib.contextmanager
def opened(path: pathlib.Path) -> Iterator[Opened]:
    """A video file's container and its stream of pictures.

    Raises DemoError if the file is missing, empty, cut short, or no video that FFmpeg decodes."""
    if not path.is_file():
        raise DemoError(f"{path}: there is no such video file.")
    try:
        # A stream, not a name: FFmpeg takes some names for addresses.
        with open(path, "rb") as file:
            _require_here(path, file.read(_HEAD))
            file.seek(0)
            require_whole(path, file)
            file.seek(0)
            with av.open(file, options=_READ) as container:
                yield container, _stream(path, container)
    except PermissionError as error:
        raise DemoError(f"{path}: this user may not read the file; change its rights.") from error
    except (av.FFmpegError, OSError) as error:
        reason = error.strerror or type(error).__name__
        raise DemoError(
            f"{path}: not a whole video file that FFmpeg can decode ({reason})."
        ) from error


def _require_here(path: pathlib.Path, head: bytes) -> None:
    if not head:
        raise DemoError(f"{path}: the video file is empty (0 bytes).")
    if head.startswith(_POINTER):
        raise DemoError(
            f"{path}: not the video but a Git LFS pointer to it; `git lfs pull` fetches the video."
        )
    if head.startswith(b"../"):
        raise DemoError(
            f"{path}: not the video but the text of a link to it, {head.decode(errors='replace')}; "
            "copy the folder with the files that its links lead to."
        )


def _stream(path: pathlib.Path, container: av.container.InputContainer) -> av.VideoStream:
    streams = moving(container)
    if not streams:
        raise DemoError(f"{path}: the file holds no video stream.")
    if streams[0].codec_context is None:
        raise DemoError(
            f"{path}: FFmpeg has no decoder for the codec of this video; convert it to H.264."
        )
    return streams[0]


def moving(container: av.container.InputContainer) -> list[av.VideoStream]:
    """The streams of moving pictures, of which the first counts; covers are none."""
    return [one for one in container.streams.video if not one.disposition & _STILL]


def shown(path: pathlib.Path, frame: av.VideoFrame) -> UInt8[np.ndarray, "H W 3"]:
    """A frame's picture in RGB, turned and mirrored as its file says."""
    across, sideways, upside_down = _turn(path, frame)
    picture = frame.to_ndarray(format="rgb24")
    if across:
        picture = picture.transpose(1, 0, 2)
    if sideways:
        picture = picture[:, ::-1]
    return np.ascontiguousarray(picture[::-1] if upside_down else picture)


def size_shown(path: pathlib.Path, frame: av.VideoFrame) -> tuple[int, int]:
    """The width and the height of a frame as it is shown."""
    size = frame.width, frame.height
    return size[::-1] if _turn(path, frame)[0] else size


def pixel_aspect(path: pathlib.Path, stream: av.VideoStream, frame: av.VideoFrame) -> float:
    """The width of a pixel in its heights, as it is shown: DV and some cameras store fewer columns
    than they show."""
    ratio = float(stream.sample_aspect_ratio or 1)
    if not 1 / _STRETCHED < ratio < _STRETCHED or abs(ratio - 1) < _SQUARE:
        return 1.0
    return 1 / ratio if _turn(path, frame)[0] else ratio


def _turn(path: pathlib.Path, frame: av.VideoFrame) -> tuple[int, int, int]:
    """Whether rows and columns are exchanged, then left and right, then top and bottom.

    A matrix (a, b; c, d) shows column x and row y at column a x + c y and row b x + d y. A
    telephone writes quarter turns, and a camera that faces its user mirrors as well."""
    try:
        matrix = frame.side_data.get(Type.DISPLAYMATRIX)
    except ValueError:  # a kind of side data that this PyAV has no name for
        return _TURNS.get(frame.rotation, (0, 0, 0))
    if matrix is None:
        return 0, 0, 0
    a, b, _, c, d = np.frombuffer(bytes(matrix), np.int32)[:5].tolist()
    straight, crossed = sorted([abs(a), abs(d)]), sorted([abs(b), abs(c)])
    if crossed[1] * _OBLIQUE <= straight[0]:  # also where all are 0, and nothing is said
        return 0, int(a < 0), int(d < 0)
    if straight[1] * _OBLIQUE <= crossed[0]:
        return 1, int(c < 0), int(b < 0)
    raise DemoError(
        f"{path}: is to be shown aslant, turned by {frame.rotation} degrees, but must be upright "
        "or turned by a quarter; write it upright."
    )
