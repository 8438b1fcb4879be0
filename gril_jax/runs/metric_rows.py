"""metrics.jsonl: one JSON object for each line, appended and flushed.

A full disk or a folder that cannot be written to is a `RunError`; earlier lines stay readable.
"""

import contextlib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.safe_files import writing


class MetricRows:
    """The file, open for appending; an incomplete last line is removed."""

    def __init__(self, file: Path):
        self.file = file
        with writing(file.parent):
            if file.exists():
                os.truncate(file, file.read_bytes().rfind(b"\n") + 1)
            self._stream = open(file, "a", encoding="utf-8")

    def append(self, row: Mapping[str, Any]) -> None:
        """Adds a line."""
        with writing(self.file.parent):
            self._stream.write(json.dumps(row) + "\n")
            self._stream.flush()

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
        lines = self.file.read_bytes().split(b"\n")[:end]
        with writing(self.file.parent):
            os.truncate(self.file, sum(len(line) + 1 for line in lines))
        return rows[:end]

    def close(self) -> None:
        """Closes the file; closing twice is harmless."""
        with contextlib.suppress(OSError):  # a full disk was reported when the line was written
            self._stream.close()


def read_rows(file: Path) -> list[dict[str, Any]]:
    """Reads all rows, oldest first, but an incomplete last line; a RunError for a damaged one."""
    try:
        lines = file.read_text(encoding="utf-8").split("\n")[:-1]
    except UnicodeDecodeError as error:
        raise RunError(f"{file} cannot be read ({error})") from None
    rows = []
    for number, line in enumerate(lines, 1):
        try:
            rows.append(json.loads(line))
        except ValueError:
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
