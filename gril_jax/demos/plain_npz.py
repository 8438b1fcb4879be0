"""Reads npz files of plain arrays that may have been written to do harm."""

import os
import zipfile
import zlib
from collections.abc import Iterable

import numpy as np

_MAX_BYTES = 1 << 30  # of the arrays, unpacked: a demonstration's have a few megabytes
# What NumPy and zipfile raise over bytes that are no npz file.
_NO_ARRAYS = (OSError, ValueError, EOFError, TypeError, AttributeError, LookupError, SyntaxError,
              NotImplementedError, RuntimeError, MemoryError, OverflowError, zipfile.BadZipFile,
              zlib.error)  # fmt: skip


class NotPlainError(Exception):
    """The file holds no plain arrays; the text says what is wrong, without the file's name."""


def read_plain(path: str | os.PathLike, names: Iterable[str]) -> dict[str, np.ndarray]:
    """Those of the named arrays that the file has; nothing is unpickled. A NotPlainError if the
    file is damaged, holds objects, is no regular file, or unpacks to more than 1 GiB."""
    if not os.path.isfile(path):  # reading from a pipe would wait for ever
        raise NotPlainError("not an npz file of plain arrays")
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size > _MAX_BYTES:
            raise NotPlainError("unpacks to more than 1 GiB")
        with np.load(path, allow_pickle=False) as file:
            found = {name: file[name] for name in names if name in file.files}
    except _NO_ARRAYS as error:
        raise NotPlainError("not an npz file of plain arrays") from error
    if not all(
        isinstance(array, np.ndarray) for array in found.values()
    ):  # a member without header
        raise NotPlainError("not an npz file of plain arrays")
    return found
