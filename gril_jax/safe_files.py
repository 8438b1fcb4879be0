"""Writing files so that a crash or a full disk leaves the old ones or the new ones, never halves.

Neither JAX nor MuJoCo is imported here.
"""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from .errors import RunError

__all__ = ["sync", "write_whole", "writing"]

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turns what the file system refuses into a RunError of one sentence."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise RunError(
                f"there is no space left to write to {folder} ({error.strerror}): what was "
                "written so far stays readable"
            ) from None
        raise RunError(f"{folder} cannot be written to ({error.strerror or error})") from None


def write_whole(file: Path, text: str) -> None:
    """The file appears complete or not at all, and is on the disk on return."""
    part = file.with_name(f".{file.name}.part")
    part.write_text(text, encoding="utf-8")
    sync(part)
    os.replace(part, file)
    sync(file.parent)


def sync(path: Path) -> None:
    """Returns once a file's contents, or a folder's list of names, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
