"""A run that `gril pretrain` or `gril train` begins or goes on with, open for writing."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from gril_jax.config import RunConfig
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress

from . import hard_negatives, setup

Echo = Callable[[str], None]


class OpenRun(NamedTuple):
    """A run, with what every part of it needs."""

    config: RunConfig
    dir: run_dir.RunDir
    progress: Progress
    echo: Echo  # says what happens
    policies: Sequence[hard_negatives.EarlierPolicy]  # that give hard negatives

    @property
    def path(self) -> Path:
        """The run's folder."""
        return self.dir.path


@contextlib.contextmanager
def opened(
    config: RunConfig, experiment: str, resume: Path | None, policies: Sequence[Path], echo: Echo
) -> Iterator[OpenRun]:
    """Opens a new run, or the one in the folder `resume`, whose configuration is its own.

    The experiment is the verb that can go on with the run. The policies are of runs that give hard
    negatives; a resumed run has noted its own. Raises ConfigError if one cannot be read, or if a
    reward of pictures is involved.
    """
    loaded = [hard_negatives.load(folder) for folder in policies]
    hard_negatives.require_boxes(config, loaded)
    known = {"device": setup.device_in_words(), "experiment": experiment}
    known["begun"] = hard_negatives.noted(loaded)
    with run_dir.create_or_resume(config, resume, **known) as run, Progress() as progress:
        echo(f"writing to {run.path}")
        yield OpenRun(config, run, progress, echo, loaded)
