"""Whether a video file has as many bytes as its own header says.

A player shows the beginning of a file that was cut short, as by a download that ended, and says
nothing. MP4 and QuickTime, Matroska and WebM, and AVI note their length. What notes none passes,
as a recording that was never closed.
"""

import os
import pathlib
from typing import BinaryIO

from gril_jax.errors import DemoError

_SLACK = 64  # bytes that a writer may have miscounted by
_BOXES = (b"ftyp", b"moov", b"mdat", b"moof", b"free", b"skip", b"wide", b"styp", b"sidx", b"uuid")
_EBML, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"


def require_whole(path: pathlib.Path, file: BinaryIO) -> None:
    """Raises DemoError if an open video file ends before its header says so."""
    size = os.fstat(file.fileno()).st_size
    head = file.read(12)
    if head[4:8] in _BOXES:
        promised = _mp4(file, size)
    elif head[:4] == _EBML:
        promised = _matroska(file)
    elif head[:4] == b"RIFF" and head[8:] == b"AVI ":
        promised = 8 + int.from_bytes(head[4:8], "little")
    else:
        return
    if promised - size > _SLACK:
        raise DemoError(
            f"{path}: not a whole video file: its header says {promised} bytes, but it has {size}; "
            "the file is cut short, so copy it again."
        )


def _mp4(file: BinaryIO, size: int) -> int:
    """The end of the last box that is known; what follows the boxes is a maker's own."""
    at = 0
    while at + 8 <= size:
        file.seek(at)
        head = file.read(16)
        length, kind = int.from_bytes(head[:4], "big"), head[4:8]
        if kind not in _BOXES or length == 0:  # 0: up to the end
            return at
        length = int.from_bytes(head[8:16], "big") if length == 1 else length
        if length < 8:
            return at
        at += length
    return at


def _matroska(file: BinaryIO) -> int:
    """The end of the segment, which holds all; 0 where its length is not known."""
    file.seek(len(_EBML))
    header, _ = _number(file)
    file.seek(header, os.SEEK_CUR)
    if file.read(4) != _SEGMENT:
        return 0
    length, known = _number(file)
    return file.tell() + length if known else 0


def _number(file: BinaryIO) -> tuple[int, bool]:
    """A length as EBML writes it, and whether it is known: of all ones it is not."""
    first = file.read(1)
    width = 9 - first[0].bit_length() if first and first[0] else 9
    if width > 8:
        return 0, False
    value = int.from_bytes(first + file.read(width - 1), "big") & ((1 << 7 * width) - 1)
    return value, value != (1 << 7 * width) - 1
