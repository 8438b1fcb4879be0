"""A run without a folder: its metrics, its finished phases and its parts, in memory alone.

    with MemoryRun() as run:
        ...                        # whatever takes a `RunDir`
    run.metrics(), run.results

`MemoryRun` has the methods of `gril_jax.runs.run_dir.RunDir` that training uses, and writes no
file: it has no checkpoints, and nothing can go on with it once it is cut off.
"""

import contextlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from .json_lines import plain
from .run_dir import RunDir


class MemoryRun:
    """A run that no folder keeps; `with` works as for one that has a folder."""

    path = None  # in place of the folder's

    def __init__(self) -> None:
        self.said: list[str] = []  # nothing is ever repaired
        self.times: list[dict[str, Any]] = []  # what `note_time` was told
        self.parts: dict[str, Any] = {}  # by name, such as "reward": what `save_part` was given
        self.arrays: dict[str, dict[str, Any]] = {}  # by name of a file, from `save_arrays`
        self.results: dict[str, Any] | None = None  # None while the run has not finished
        self._finished: dict[str, dict[str, Any]] = {}
        self._rows: list[dict[str, Any]] = []

    def log(self, **metrics: Any) -> None:
        """Adds one row of metrics, as numbers, strings and lists of them."""
        self._rows.append(plain(metrics))

    def metrics(self) -> list[dict[str, Any]]:
        """The rows so far, with their clocks."""
        return list(self._rows)

    def note_time(self, **fields: Any) -> None:
        """Adds to `times`."""
        self.times.append(plain(fields))

    def finished_phase(self, name: str) -> dict[str, Any] | None:
        """The results of a phase, or None while it has not finished."""
        return self._finished.get(name)

    def finish_phase(
        self, name: str, results: Mapping[str, Any], files: Iterable[Path] = ()
    ) -> None:
        """Notes that a phase has finished."""
        del files
        self._finished[name] = dict(results)

    def cover(self, phase: str, files: Iterable[Path] = ()) -> None:
        """Does nothing: there are no files."""

    def save_part(self, part: str, step: int, state: Any) -> list[Path]:
        """Keeps a part of the run, such as "reward"; returns no files."""
        del step
        self.parts[part] = state
        return []

    def load_part(self, part: str, like: Any) -> Any:
        """What `save_part` was given."""
        del like
        return self.parts[part]

    def save_arrays(self, name: str, **arrays: Any) -> list[Path]:
        """Keeps arrays under the name of the file that a folder would have; returns no files."""
        self.arrays[name] = arrays
        return []

    def newest(self, phase: str, state: Any, tell: Any) -> tuple[Any, int]:
        """The fresh state and 0 chunks: without a checkpoint a phase always begins anew."""
        del tell
        self._rows = [row for row in self._rows if row.get("phase") != phase]
        return state, 0

    def saving(self, phase: str, *, keep: int) -> contextlib.nullcontext[None]:
        """No writer of checkpoints."""
        del phase, keep
        return contextlib.nullcontext()

    def settle(self, phase: str) -> None:
        """Does nothing: there are no checkpoints to remove."""

    def cut_off(self, where: str) -> str:
        """What is said of a run that a signal ends at some point."""
        return f"the run ends {where}: without a folder nothing of it is kept"

    def finish(self, results: Mapping[str, Any]) -> None:
        """Sets `results`."""
        self.results = plain(results)

    def close(self) -> None:
        """Does nothing: nothing is open."""

    def __enter__(self) -> "MemoryRun":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


Run: TypeAlias = RunDir | MemoryRun  # what training takes
