"""metrics.jsonl: the metrics of a run, a row for each chunk of a phase.

A mark, {"lines": 12, "bytes": 3400, "sha256": "..."}, says what the file was at some moment. Each
checkpoint has one, and phases.json that of the phase that finished last: up to there the file is
covered.
"""

import hashlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.safe_files import writing

from .json_lines import JsonLines, Row, parsed

Mark = Mapping[str, Any]


class MetricRows(JsonLines):
    """The file, open for appending, with a mark of what is in it."""

    def __init__(self, file: Path):
        super().__init__(file)
        self._count_again()

    def append(self, row: Mapping[str, Any]) -> bytes:
        """Adds a line and returns it."""
        line = super().append(row)
        self._sha.update(line)
        self._lines, self._bytes = self._lines + 1, self._bytes + len(line)
        return line

    def mark(self) -> dict[str, Any]:
        """The lines so far."""
        return {"lines": self._lines, "bytes": self._bytes, "sha256": self._sha.hexdigest()}

    def keep(self, phase: str, count: int) -> list[Row]:
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


def read_rows(file: Path, marks: Iterable[Mark] = (), *, whole: bool = False) -> list[Row]:
    """Reads all rows, oldest first, but an incomplete last line.

    A RunError for a damaged one, for lines that are not those of a mark, and, if the `whole` file
    must be covered, for lines after all marks.
    """
    data, marks = file.read_bytes(), [*marks]
    rows = parsed(file, data)
    for mark in marks:
        lines, size = mark["lines"], mark["bytes"]
        if len(data) < size:
            raise RunError(f"{file} holds {len(rows)} whole lines, but the run had written {lines}")
        if hashlib.sha256(data[:size]).hexdigest() != mark["sha256"]:
            raise RunError(f"{file}: lines 1 to {lines} are not those that the run wrote")
    if whole and len(data) > max((mark["bytes"] for mark in marks), default=0):
        raise RunError(f"{file} goes on after the last line that the run wrote")
    return rows
