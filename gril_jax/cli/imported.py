"""The work of the verbs that import demonstrations."""

from pathlib import Path
from typing import Any

from .arguments import Work, echo
from .heavy_imports import heavy_imports


def imported(function: str, source: Path, out: Path, *args: Any, **options: Any) -> Work:
    """A set made by a function of `gril_jax.demos.importing`, which tells its progress."""

    def work() -> None:
        with heavy_imports():
            from gril_jax.demos import importing
            from gril_jax.runs.progress import Progress

        with Progress() as progress:
            phase = progress.phase("reading", total=0, unit="demonstrations", compiles=False)

            def tell(done: int, total: int, last: object) -> None:
                phase.total = total
                phase.update(done)

            getattr(importing, function)(source, out, *args, **options, progress=tell)
        echo(f"wrote {out}")

    return work
