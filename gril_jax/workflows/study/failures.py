"""Rows that fail: an error ends neither the other rows nor the study."""

from collections.abc import Iterable, Sequence

from gril_jax.compilation import ahead
from gril_jax.errors import GrilError
from gril_jax.runs.interrupt import Interrupted

from .rows import Row

PHASE = "failed"  # of a run: a sentence for each row that failed, by the row's place


class Failures:
    """The rows that have failed, and the tasks that cannot be done for it."""

    def __init__(self) -> None:
        self.cells: dict[int, str] = {}  # place of a row to a sentence without its full stop
        self._tasks: set[str] = set()

    def guarded(self, task: ahead.Task, rows: Sequence[Row]) -> ahead.Task:
        """The task, whose errors are noted for its rows; it is left out if what it needs failed."""

        def do() -> None:
            if task.needs & self._tasks:
                self._tasks.add(task.name)
                return
            try:
                task.do()
            except Interrupted:
                raise
            except Exception as error:
                self._tasks.add(task.name)
                self.note(rows, error)

        return task._replace(do=do)

    def note(self, rows: Iterable[Row], error: Exception) -> None:
        """Notes what went wrong with some rows; the first error of a row counts."""
        for row in rows:
            self.cells.setdefault(row.cell, sentence(error))


def sentence(error: Exception) -> str:
    """An error in one line, without its full stop."""
    first = next(iter(str(error).splitlines()), "").strip().rstrip(".")
    if isinstance(error, GrilError):
        return first
    return f"{type(error).__name__}: {first}"[:300]
