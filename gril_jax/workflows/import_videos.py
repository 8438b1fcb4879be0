"""Makes a demonstration set of a folder of videos, and pictures to look at before learning.

gril demos import-videos FOLDER --robot hand --out mine

`import.txt` in the set says what was found in each video and what was repaired. `import.png` shows
pictures of each video with the boxes as the set has them.
"""

import errno
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gril_jax.config import EnvConfig
from gril_jax.demos.demo_set import DemoSet
from gril_jax.demos.folders import visible
from gril_jax.demos.importing import import_videos
from gril_jax.errors import ConfigError, DemoError
from gril_jax.report.filmstrip import Film, contact_sheet
from gril_jax.report.style import png
from gril_jax.runs.progress import Progress
from gril_jax.safe_files import write_whole, writing
from gril_jax.workflows.build import setup, vocabulary

_OF_THE_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.EACCES)
_SHOWN = 12  # videos on the contact sheet, at most


def main(
    source: Path,
    out: Path,
    *,
    task: str | None = None,
    robot: Sequence[str] = (),
    boxes: str = "auto",
    echo: Callable[[str], None] = print,
    **options: Any,
) -> DemoSet:
    """Writes the set of `import_videos`, whose options these are, and returns it.

    Boxes that come with videos of a task must be of its classes; its robot is the task's.
    """
    if task is not None and boxes != "colour" and not visible(source, "*.pkl.gz"):
        env = setup.make_env(EnvConfig(name=task), training=False)
        options["classes"] = env.classes
        robot = robot or vocabulary.of_task(env, task).robots
    with Progress() as progress:
        options |= {"task": task, "robot": robot, "boxes": boxes}
        options |= {"progress": progress.steps("reading", "videos"),
                    "writing": progress.steps("writing", "videos"),
                    "detecting": progress.steps("detecting", "frames")}  # fmt: skip
        try:
            made = import_videos(source, out, **options)
        except DemoError as error:
            if getattr(error.__cause__, "errno", None) in _OF_THE_DISK:
                raise
            raise ConfigError(str(error)) from None  # what is given is wrong, not the work
    if made.notes:
        with writing(out):
            write_whole(out / "import.png", png(sheet(made)))
        echo(made.notes.split("\n\n")[0])
        echo(f"look at {out / 'import.png'}; each video is in {out / 'import.txt'}")
    echo(f"wrote {out}")
    return made


def sheet(demo_set: DemoSet):
    """Four pictures of each video with the boxes of the set."""
    films = []
    for demo in demo_set.demos[:_SHOWN]:
        shown = np.flatnonzero(demo.tracks.seen.any(axis=0))
        own = demo.tracks.of(shown)
        thick = np.ones(own.seen.shape, bool)
        films.append(Film(demo.name, demo.frames, own, thick))
    return contact_sheet(films, demo_set.classes, demo_set.half_extent)
