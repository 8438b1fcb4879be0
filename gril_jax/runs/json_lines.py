"""Files of one JSON object for each line, appended and flushed."""

import contextlib
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.safe_files import writing

Row = dict[str, Any]


class JsonLines:
    """A file, open for appending; an incomplete last line is removed.

    A full disk or a folder that cannot be written to is a `RunError`; earlier lines stay readable.
    """

    def __init__(self, file: Path):
        self.file = file
        self.said = ""  # a sentence on what was removed
        with writing(file.parent):
            data = file.read_bytes() if file.exists() else b""
            end = data.rfind(b"\n") + 1
            if end < len(data):
                self.said = f"the last line of {file} was cut short, and is left out"
                os.truncate(file, end)
            self._stream = open(file, "ab")

    def append(self, row: Mapping[str, Any]) -> bytes:
        """Adds a line and returns it."""
        line = (json.dumps(row) + "\n").encode()
        with writing(self.file.parent):
            self._stream.write(line)
            self._stream.flush()
        return line

    def sync(self) -> None:
        """Returns once the lines so far are on disk."""
        with writing(self.file.parent):
            os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Closes the file; closing twice is harmless."""
        with contextlib.suppress(OSError):  # a full disk was reported when the line was written
            self._stream.close()


def parsed(file: Path, data: bytes) -> list[Row]:
    """The rows in a file's contents, but an incomplete last one; a RunError for a damaged one."""
    rows = []
    for number, line in enumerate(data.split(b"\n")[:-1], 1):
        try:
            rows.append(json.loads(line.decode()))
        except UnicodeDecodeError:
            raise RunError(f"{file}: line {number} is not text") from None
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
