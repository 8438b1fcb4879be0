"""Table, figures and page of a run of Table I again, from the run's files alone.

gril report RUN                    seconds
"""

from collections.abc import Callable
from pathlib import Path

from gril_jax.errors import RunError

from . import results as table1_results

__all__ = ["main"]


def main(folder: Path, echo: Callable[[str], None] = print) -> Path:
    """Draws them of the policies that have finished; returns the page.

    Raises:
      RunError: none has finished yet, a file of the run is missing or damaged, or the folder cannot
        be written to.
    """
    found = table1_results.read(folder)
    if not found.lines:
        raise RunError(f"{folder} has no policy that has finished, so its table is still empty")
    table1_results.write(folder, found)
    echo(f"report: {folder / 'report.html'}")
    return folder / "report.html"
