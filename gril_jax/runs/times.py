"""times.jsonl: all clocks of a run; nothing else in its folder tells the time.

    {"started": "2030-01-01T12:00:00+0000", ...}    a process has taken the run up
    {"line": 12, "seconds": 3.25, ...}              of line 12 of metrics.jsonl
    {"stage": "reward", "seconds": 70.5, ...}       of a stage, in the process that finished it

Of two lines for the same the later one counts: a run that goes on does the work after its last
checkpoint again. No other file depends on this one, so that a run goes on without it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError

from .json_lines import Row, parsed

FILE = "times.jsonl"
CLOCKS = ("seconds", "env_steps_per_s")  # fields of a row that go here


def read_times(folder: Path) -> list[Row]:
    """The lines so far, none without the file; a RunError if it is damaged."""
    file = folder / FILE
    try:
        return parsed(file, file.read_bytes() if file.exists() else b"")
    except OSError as error:
        raise RunError(f"{file} cannot be read ({error.strerror})") from None
    except RunError as error:
        raise RunError(f"{error}: remove it, and the run goes on without its times") from None


def with_clocks(rows: Sequence[Mapping[str, Any]], times: Sequence[Row]) -> list[Row]:
    """Rows of metrics.jsonl with their clocks, as far as these are known."""
    by_line = {time["line"]: time for time in times if "line" in time}
    each = [by_line.get(number, {}) for number in range(1, len(rows) + 1)]
    return [
        {**row, **{name: clocks[name] for name in CLOCKS if name in clocks}}
        for row, clocks in zip(rows, each, strict=True)
    ]


def started(folder: Path) -> str | None:
    """When a run began; None if its times.jsonl does not say."""
    return next((time["started"] for time in read_times(folder) if "started" in time), None)
