"""The files of a run with one JSON object a line, appended and flushed: metrics and clocks.

    metrics.jsonl    a row for each chunk of a phase
    times.jsonl      all clocks of a run; nothing else in its folder tells the time, or the place:
      {"started": "2030-01-01T12:00:00+0000", ...}    a process has taken the run up
      {"folder": "/home/me/run", ...}                 where it began, see `places`
      {"line": 12, "seconds": 3.25, ...}              of line 12 of metrics.jsonl
      {"stage": "reward", "seconds": 70.5, ...}       of a stage, in the process that finished it

A mark, {"lines": 12, "bytes": 3400, "sha256": "..."}, says what metrics.jsonl was at some time.
Each checkpoint has one, and phases.json that of the phase that finished last: up to there the file
is covered, and a run that goes on does the work after its mark again. Of two lines of times.jsonl
for the same the later one counts; no other file depends on it, so that a run goes on without it.
"""

import contextlib
import errno
import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.safe_files import writing

Row = dict[str, Any]
Mark = Mapping[str, Any]

TIMES = "times.jsonl"
CLOCKS = ("seconds", "env_steps_per_s")  # fields of a row that go there


class JsonLines:
    """A file, open for appending; an incomplete last line is removed.

    A full disk or a folder that cannot be written to is a `RunError`; earlier lines stay readable.
    """

    def __init__(self, file: Path):
        self.file = file
        self.said = ""  # a sentence on what was removed
        with writing(file.parent):
            data = file.read_bytes() if file.exists() else b""
            whole = data[: data.rfind(b"\n") + 1]
            if len(whole) < len(data):
                self.said = f"the last line of {file} was cut short, and is left out"
                os.truncate(file, len(whole))
            self._stream = open(file, "ab", buffering=0)
        self._count(whole)

    def _count(self, data: bytes) -> None:
        self._sha, self._bytes, self._lines = hashlib.sha256(data), len(data), data.count(b"\n")

    def append(self, row: Mapping[str, Any]) -> None:
        """Adds a line."""
        line = (json.dumps(row) + "\n").encode()
        with writing(self.file.parent):
            try:
                if self._stream.write(line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            except OSError:  # else a part of it would stand before the next line
                os.truncate(self.file, self._bytes)
                raise
        self._sha.update(line)
        self._lines, self._bytes = self._lines + 1, self._bytes + len(line)

    def mark(self) -> dict[str, Any]:
        """The lines so far."""
        return {"lines": self._lines, "bytes": self._bytes, "sha256": self._sha.hexdigest()}

    def cut(self, lines: int) -> int:
        """Truncates the file after so many lines; the number of those that are left out."""
        left_out = self._lines - lines
        with writing(self.file.parent):
            kept = b"".join(self.file.read_bytes().splitlines(keepends=True)[:lines])
            os.truncate(self.file, len(kept))
        self._count(kept)
        return left_out

    def sync(self) -> None:
        """Returns once the lines so far are on disk."""
        with writing(self.file.parent):
            os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Closes the file; closing twice is harmless."""
        with contextlib.suppress(OSError):  # a full disk was reported when the line was written
            self._stream.close()


def read_rows(file: Path, marks: Iterable[Mark] = (), *, whole: bool = False) -> list[Row]:
    """Reads all rows, oldest first, but an incomplete last line.

    A RunError for a damaged one, for lines that are not those of a mark, and, if the `whole` file
    must be covered, for lines after all marks.
    """
    data, marks, rows = file.read_bytes(), [*marks], list[Row]()
    for number, line in enumerate(data.split(b"\n")[:-1], 1):
        try:
            rows.append(json.loads(line.decode()))
        except UnicodeDecodeError:
            raise RunError(f"{file}: line {number} is not text") from None
        except (ValueError, RecursionError):
            raise RunError(f"{file}: line {number} is not JSON") from None
        if not isinstance(rows[-1], dict):
            raise RunError(f"{file}: line {number} must be an object")
    for mark in marks:
        lines, size = mark["lines"], mark["bytes"]
        if len(data) < size:
            raise RunError(f"{file} holds {len(rows)} whole lines, but the run had written {lines}")
        if hashlib.sha256(data[:size]).hexdigest() != mark["sha256"]:
            raise RunError(f"{file}: lines 1 to {lines} are not those that the run wrote")
    if whole and len(data) > max((mark["bytes"] for mark in marks), default=0):
        raise RunError(f"{file} goes on after the last line that the run wrote")
    return rows


def read_times(folder: Path) -> list[Row]:
    """The clocks so far, none without the file; a RunError if it is damaged."""
    file = folder / TIMES
    try:
        return read_rows(file) if file.exists() else []
    except OSError as error:
        raise RunError(f"{file} cannot be read ({error.strerror})") from None
    except RunError as error:
        raise RunError(f"{error}: remove it, and the run goes on without its times") from None


def with_clocks(rows: Sequence[Row], folder: Path) -> list[Row]:
    """Rows of metrics.jsonl with their clocks, as far as these are known."""
    by_line = {time["line"]: time for time in read_times(folder) if "line" in time}
    known = [by_line.get(number, {}) for number in range(1, len(rows) + 1)]
    clocks = [{name: each[name] for name in CLOCKS if name in each} for each in known]
    return [row | clock for row, clock in zip(rows, clocks, strict=True)]


def started(folder: Path) -> str | None:
    """When a run began; None if its times.jsonl does not say."""
    return next((time["started"] for time in read_times(folder) if "started" in time), None)


def plain(value: Any) -> Any:
    """Numbers, strings and lists of them, from Python's, NumPy's or JAX's; null if not finite."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def with_digest(content: Mapping[str, Any]) -> str:
    """A JSON object as text, with the SHA-256 of its sorted fields as another field."""
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return json.dumps({**content, "sha256": digest}, indent=1)


def without_digest(text: str) -> dict[str, Any] | None:
    """The object that `with_digest` wrote; None if it has changed, a ValueError if it is none."""
    try:
        content = json.loads(text)
        del content["sha256"]
        return content if text == with_digest(content) else None
    except (KeyError, AttributeError, TypeError, RecursionError) as error:
        raise ValueError(str(error)) from error
