"""Demonstrations in Python: read from videos, or from a folder of demonstrations."""

import os
from typing import Any

from gril_jax.demos import importing
from gril_jax.demos.demo_set import DemoSet, load_demo_set
from gril_jax.runs.progress import Progress


def import_videos(
    folder: str | os.PathLike,
    out: str | os.PathLike | None = None,
    *,
    progress: bool = True,
    **options: Any,
) -> DemoSet:
    """The demonstrations of a folder of videos, with the boxes beside them.

    Args:
      folder: videos with a file of boxes each, MAGICAL's `*.pkl.gz` files, or a LeRobot dataset.
      out: a folder to write the demonstrations to; None keeps them in memory.
      progress: show a progress line on stderr.
      options: those of `gril_jax.demos.importing.import_videos`, such as `robot=["hand"]`, the
        classes that belong to a robot or a person, `boxes`, `fps` and `half_extent`.

    Raises:
      DemoError: no videos, a damaged one, or boxes that are missing, malformed or do not fit.

    Example:
      demos = import_videos("films", robot=["hand"])
    """
    with Progress(shown=progress) as shown:
        phase = None

        def tell(done: int, total: int) -> None:
            nonlocal phase
            if phase is None:
                phase = shown.phase("reading videos", total=total, unit="steps", compiles=False)
            phase.update(done)

        return importing.import_videos(folder, out, progress=tell, **options)


def load_demos(folder: str | os.PathLike) -> DemoSet:
    """The demonstrations in a folder of `import_videos` or of `gril demos`.

    Raises:
      DemoError: there are none, or a file is missing or was changed.

    Example:
      demos = load_demos("mine")
    """
    return load_demo_set(folder)
