"""times.jsonl: all clocks of a run; nothing else in its folder tells the time.

    {"started": "2030-01-01T12:00:00+0000", ...}    a process has taken the run up
    {"line": 12, "seconds": 3.25, ...}              of line 12 of metrics.jsonl
    {"stage": "reward", "seconds": 70.5, ...}       of a stage, in the process that finished it

Each line ends with "check", of itself and of all lines before it. Of two lines for the same the
later one counts: a run that goes on does the work after its last checkpoint again.
"""

import contextlib
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.safe_files import writing

from .metric_rows import plain

FILE = "times.jsonl"
CLOCKS = ("seconds", "env_steps_per_s")  # fields of a row that go here

Row = dict[str, Any]


class Times:
    """The file, open for appending.

    Lines that are damaged are set aside beside it and cut off with all that follow them; `said` is
    then a sentence on it, and a line {"lost": ...} allows for what is missing.
    """

    def __init__(self, file: Path, *, expected: bool):
        """`expected` if a run that goes on must have the file."""
        self.file, self.said = file, ""
        with writing(file.parent):
            data = file.read_bytes() if file.exists() else b""
            _, self._last, end, fault = _checked(data)
            if fault:
                file.with_name(f"{FILE}.damaged").write_bytes(data)
            if end < len(data):
                os.truncate(file, end)
            self._stream = open(file, "ab")
        if fault or (expected and not data):
            self._lose(fault or "it is missing or empty")
        elif end < len(data):
            self.said = f"the last line of {file} was cut short, and is left out"

    def expect(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Notes that times are lost if there are none of one of these rows."""
        lacking = _first_lacking(rows, self.read())
        if lacking is not None:
            self._lose(f"it has no times of line {lacking} of metrics.jsonl")

    def _lose(self, fault: str) -> None:
        self.said = f"{self.file} is damaged ({fault}): the run goes on without the times lost"
        self.append(lost=fault)

    def read(self) -> list[Row]:
        """The lines so far, from the file: a long run has millions."""
        with writing(self.file.parent):
            return _checked(self.file.read_bytes())[0]

    def append(self, **fields: Any) -> None:
        """Adds a line."""
        line, self._last = _line(plain(fields), self._last)
        with writing(self.file.parent):
            self._stream.write(line)
            self._stream.flush()

    def sync(self) -> None:
        """Returns once the lines so far are on disk."""
        with writing(self.file.parent):
            os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Closes the file; closing twice is harmless."""
        with contextlib.suppress(OSError):
            self._stream.close()


def read_times(folder: Path, *, expected: bool) -> list[Row]:
    """The lines without their checks; a RunError if one is damaged, or the file missing though it
    is expected. An incomplete last line is left out."""
    file = folder / FILE
    try:
        data = file.read_bytes()
    except FileNotFoundError:
        data = b""
    except OSError as error:
        raise RunError(f"{file} cannot be read ({error.strerror})") from None
    if not data:
        if expected:
            raise RunError(f"{file} is missing or empty, but the run had written it")
        return []
    rows, _, _, fault = _checked(data)
    if fault:
        raise RunError(f"{file}: {fault}")
    return rows


def with_clocks(rows: Sequence[Mapping[str, Any]], times: Sequence[Row], file: Path) -> list[Row]:
    """Rows of metrics.jsonl with their clocks; a RunError if times of one are missing.

    Rows of older versions have their own.
    """
    lacking = _first_lacking(rows, times)
    if lacking is not None:
        raise RunError(f"{file} has no times of line {lacking} of metrics.jsonl")
    by_line = _by_line(times)
    found = []
    for number, row in enumerate(rows, 1):
        clocks = by_line.get(number, {})
        found.append({**row, **{name: clocks[name] for name in CLOCKS if name in clocks}})
    return found


def _by_line(times: Sequence[Row]) -> dict[int, Row]:
    return {time["line"]: time for time in times if "line" in time}


def _first_lacking(rows: Sequence[Mapping[str, Any]], times: Sequence[Row]) -> int | None:
    """The first line of metrics.jsonl without times, unless a line with "lost" allows for it."""
    if not times or any("lost" in time for time in times):
        return None
    by_line = _by_line(times)
    lines = enumerate(rows, 1)
    return next((n for n, row in lines if n not in by_line and "seconds" not in row), None)


def started(folder: Path) -> str | None:
    """When a run began, as its times.jsonl has it; None if it does not say."""
    times = read_times(folder, expected=False)
    return next((time["started"] for time in times if "started" in time), None)


def _line(row: Row, last: str) -> tuple[bytes, str]:
    check = hashlib.sha256((last + json.dumps(row)).encode()).hexdigest()[:16]
    return (json.dumps({**row, "check": check}) + "\n").encode(), check


def _checked(data: bytes) -> tuple[list[Row], str, int, str]:
    """The rows up to the first damaged one, the last check, where they end, and the damage."""
    rows, last, end = list[Row](), "", 0
    for number, line in enumerate(data.split(b"\n")[:-1], 1):
        try:
            row = json.loads(line)
            del row["check"]
            again, check = _line(row, last)
        except (ValueError, KeyError, TypeError, RecursionError):
            return rows, last, end, f"line {number} is damaged"
        if again != line + b"\n":
            return rows, last, end, f"line {number} is not the one that the run wrote there"
        rows.append(row)
        last, end = check, end + len(again)
    return rows, last, end, ""
