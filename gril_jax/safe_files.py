"""Writes files so that a crash or a full disk leaves the old ones or the new ones, never halves,
and one process at a time writes to a folder.
"""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, TextIO
from urllib.parse import quote

from .errors import RunError

_LONGEST = 200  # bytes of a file's name, to which a number and an ending may be added
_NO_LETTERS = '%/\\:*?"<>|'  # of files' names, on one system or another
_RAW = "surrogatepass"  # of names that are no text, as those of some files are
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turns file system errors into a RunError of one sentence."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise RunError(
                f"there is no space left to write to {folder} ({error.strerror}): what was "
                "written so far stays readable"
            ) from None
        raise RunError(f"{folder} cannot be written to ({error.strerror or error})") from None


def cause(error: OSError) -> str:
    """Why a file could not be written, as the end of a sentence."""
    said = error.strerror or str(error)
    return f"there is no space left ({said})" if error.errno in _FULL else said


def write_whole(file: Path, contents: str | bytes, *, durable: bool = True) -> None:
    """The file appears complete or not at all, and on return, if durable, is on the disk."""
    part = file.with_name(f".{file.name}.part")
    part.unlink(missing_ok=True)  # a link of this name would lead to another file
    part.write_bytes(contents.encode() if isinstance(contents, str) else contents)
    if durable:
        sync(part)
    os.replace(part, file)
    if durable:
        sync(file.parent)


def file_name(name: str) -> str:
    """The name of a file, without its ending, for any text: other texts have other names, and
    `urllib.parse.unquote` gives the text back, unless the name ends with the digest of a long one.

    >>> file_name("a/b 0"), file_name("a_b 0"), file_name(".."), file_name("50 %")
    ('a%2Fb 0', 'a_b 0', '%2E.', '50 %25')
    """
    plain = lambda c: c.isprintable() and c not in _NO_LETTERS  # noqa: E731
    made = "".join(c if plain(c) else quote(c, "", errors=_RAW) for c in name)
    made = f"%2E{made[1:]}" if made[:1] == "." else made
    raw = made.encode(errors=_RAW)
    if len(raw) <= _LONGEST:
        return made
    digits = hashlib.sha256(name.encode(errors=_RAW)).hexdigest()
    return f"{raw[: _LONGEST - len(digits) - 1].decode(errors='ignore')} {digits}"


def digest(file: Path) -> str:
    """The SHA-256 of a file's contents, in hexadecimal."""
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def require_regular(file: Path) -> None:
    """Raises a RunError for a pipe or a device, which may never end; what is missing passes."""
    if file.exists() and not file.is_file() and not file.is_dir():
        raise RunError(f"{file} is no regular file")


def read_object(file: Path) -> dict[str, Any]:
    """A JSON object; a RunError for any other contents, a FileNotFoundError without the file."""
    require_regular(file)
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"{file} cannot be read ({error})") from None
    except (ValueError, RecursionError):
        raise RunError(f"{file} is not JSON") from None
    if not isinstance(found, dict):
        raise RunError(f"{file} must be an object with fields")
    return found


@contextlib.contextmanager
def new_file(path: Path, *, overwrite: bool = False) -> Iterator[BinaryIO]:
    """A stream into a file that appears under its name, whole, when the block ends well; a
    FileExistsError if there is one that is not to be overwritten."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    claimed = False
    try:
        with open(part, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        if not overwrite:
            open(path, "xb").close()  # takes the name: whatever came in between is kept
            claimed = True
        os.replace(part, path)
        claimed = False
    finally:
        part.unlink(missing_ok=True)
        if claimed:
            path.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Returns once a file's contents, or a folder's list of names, are on disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def take_lock(folder: Path, *, note: bool = True) -> TextIO:
    """Locks the file `lock` of a folder until it is closed, and notes this process's id in it; a
    RunError if a process has the lock, this one included.

    The kernel drops the lock with the process, however it ends; the file stays behind.
    """
    lock = open(folder / "lock", "a+", encoding="utf-8")  # closed by the caller
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.seek(0)
        holder = lock.read().strip() or "unknown"
        lock.close()
        raise RunError(
            f"{folder} is being written by process {holder}: wait for it or give another folder"
        ) from None
    if note:
        lock.truncate(0)
        lock.write(f"{os.getpid()}\n")
        lock.flush()
    return lock
