"""A run that is open for writing, as `gril pretrain` and `gril train` begin it or go on with it."""

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
    policies: Sequence[hard_negatives.EarlierPolicy] = ()  # that give hard negatives

    @property
    def path(self) -> Path:
        """The run's folder."""
        return self.dir.path


@contextlib.contextmanager
def opened(
    config: RunConfig,
    experiment: str,
    *,
    resume: Path | None = None,
    policies: Sequence[Path] = (),
    echo: Echo = print,
) -> Iterator[OpenRun]:
    """Opens a new run, or the one in the folder `resume`.

    Args:
      config: a resumed run's is its own.
      experiment: the verb that can go on with the run.
      resume: the folder of a run that was cut off.
      policies: runs whose policies give hard negatives; a resumed run has noted its own.
      echo: says what happens.

    Raises:
      ConfigError: an earlier policy cannot be read, or a reward of pictures is involved.
      RunError: see `gril_jax.runs.run_dir.create_or_resume`.
    """
    loaded = hard_negatives.load(policies)
    hard_negatives.require_boxes(config, loaded)
    known = {"device": setup.device_in_words(), "experiment": experiment}
    begun = hard_negatives.noted(loaded)
    with (
        run_dir.create_or_resume(config, resume, begun=begun, **known) as run,
        Progress() as progress,
    ):
        echo(f"writing to {run.path}")
        yield OpenRun(config, run, progress, echo, loaded)
