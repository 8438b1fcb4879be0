"""metrics.jsonl: one JSON object for each line, appended and flushed.

A mark, {"lines": 12, "bytes": 3400, "sha256": "..."}, says what the file was at some moment. Each
checkpoint has one, and phases.json that of the phase that finished last: up to there the file is
covered. A full disk or a folder that cannot be written to is a `RunError`; earlier lines stay
readable.
"""

import contextlib
import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.safe_files import writing

Mark = Mapping[str, Any]


class MetricRows:
    """The file, open for appending; an incomplete last line is removed."""

    def __init__(self, file: Path):
        self.file = file
        self.said = ""  # a sentence on what was removed
        with writing(file.parent):
            if file.exists():
                data = file.read_bytes()
                end = data.rfind(b"\n") + 1
                if end < len(data):
                    self.said = f"the last line of {file} was cut short, and is left out"
                os.truncate(file, end)
            self._stream = open(file, "ab")
        self._count_again()

    def append(self, row: Mapping[str, Any]) -> None:
        """Adds a line."""
        line = (json.dumps(row) + "\n").encode()
        with writing(self.file.parent):
            self._stream.write(line)
            self._stream.flush()
        self._sha.update(line)
        self._lines, self._bytes = self._lines + 1, self._bytes + len(line)

    def mark(self) -> dict[str, Any]:
        """The lines so far."""
        return {"lines": self._lines, "bytes": self._bytes, "sha256": self._sha.hexdigest()}

    def sync(self) -> None:
        """Returns once the lines so far are on disk."""
        with writing(self.file.parent):
            os.fsync(self._stream.fileno())

    def keep(self, phase: str, count: int) -> list[dict[str, Any]]:
        """Truncates the file after the first `count` rows of a phase, which must be its last phase.

        Returns the rows that are left, of all phases; a `RunError` if there are fewer of the phase.
        """
        rows = read_rows(self.file)
        mine = [i for i, row in enumerate(rows) if row.get("phase") == phase]
        if len(mine) < count:
            raise RunError(
                f"{self.file} holds {len(mine)} rows of phase {phase!r}, but its checkpoint was "
                f"saved after {count}, so lines have been lost"
            )
        end = len(rows) if len(mine) == count else mine[count]
        self._cut(end)
        return rows[:end]

    def cut_after(self, mark: Mark | None, finished: Iterable[str]) -> None:
        """Truncates the file after a mark, where the first row follows of a phase that is not among
        the finished ones: its work is done again."""
        rows, begin = read_rows(self.file), mark["lines"] if mark else 0
        redone = (row.get("phase", None) not in {None, *finished} for row in rows[begin:])
        end = next((begin + i for i, again in enumerate(redone) if again), len(rows))
        self._cut(end)
        if end < len(rows):
            self.said += (
                f"{'; ' * bool(self.said)}{len(rows) - end} lines of {self.file} after the last "
                "checkpoint are left out: their work is done again"
            )

    def _cut(self, lines: int) -> None:
        kept = self.file.read_bytes().split(b"\n")[:lines]
        with writing(self.file.parent):
            os.truncate(self.file, sum(len(line) + 1 for line in kept))
        self._count_again()

    def _count_again(self) -> None:
        with writing(self.file.parent):
            data = self.file.read_bytes()
        self._sha, self._bytes, self._lines = hashlib.sha256(data), len(data), data.count(b"\n")

    def close(self) -> None:
        """Closes the file; closing twice is harmless."""
        with contextlib.suppress(OSError):  # a full disk was reported when the line was written
            self._stream.close()


def read_rows(
    file: Path, marks: Iterable[Mark] = (), *, whole: bool = False
) -> list[dict[str, Any]]:
    """Reads all rows, oldest first, but an incomplete last line.

    A RunError for a damaged one, for lines that are not those of a mark, and, if the `whole` file
    must be covered, for lines after all marks.
    """
    data, marks = file.read_bytes(), [*marks]
    rows = _parsed(file, data)
    for mark in marks:
        lines, size = mark["lines"], mark["bytes"]
        if len(data) < size:
            raise RunError(f"{file} holds {len(rows)} whole lines, but the run had written {lines}")
        if hashlib.sha256(data[:size]).hexdigest() != mark["sha256"]:
            raise RunError(f"{file}: lines 1 to {lines} are not those that the run wrote")
    covered = max((mark["bytes"] for mark in marks), default=0)
    if whole and len(data) > covered:
        raise RunError(f"{file} goes on after the last line that the run wrote")
    return rows


def _parsed(file: Path, data: bytes) -> list[dict[str, Any]]:
    try:
        lines = data.decode().split("\n")[:-1]
    except UnicodeDecodeError as error:
        number = data.count(b"\n", 0, error.start) + 1
        raise RunError(f"{file}: line {number} is not text") from None
    rows = []
    for number, line in enumerate(lines, 1):
        try:
            rows.append(json.loads(line))
        except (ValueError, RecursionError):
            raise RunError(f"{file}: line {number} is not JSON") from None
        if not isinstance(rows[-1], dict):
            raise RunError(f"{file}: line {number} must be an object")
    return rows


def plain(value: Any) -> Any:
    """Numbers, strings and lists of them, from Python's, NumPy's or JAX's; null if not finite."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
