"""Draws a run's figures and its page again, in seconds: `gril report RUN`."""

from collections.abc import Callable
from pathlib import Path

from gril_jax.report import run_report


def main(folder: Path, *, demos: Path | None = None, echo: Callable[[str], None] = print) -> Path:
    """Writes the report of a run from its folder and its demonstration set, which is at `demos` if
    it has been moved; returns the page."""
    page = run_report.write_report(folder, demos=demos)
    echo(f"report: {page}")
    return page
