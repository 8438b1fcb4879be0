"""Scripted demonstrations: a task's expert plays, and its videos become demonstrations."""

import os
from pathlib import Path
from typing import Any

from gril_jax.demos.demo_set import DemoSet
from gril_jax.runs.progress import Progress
from gril_jax.types import checked
from gril_jax.workflows.build import make_demos

from . import settings


@checked
def record_demos(
    task: Any,
    out: str | os.PathLike,
    *,
    preset: str | None = None,
    variant: str | None = None,
    seed: int = 0,
    progress: bool = True,
    **options: Any,
) -> DemoSet:
    """Demonstrations of a task by its scripted expert, read from the videos of its episodes.

    Args:
      task: with an expert, by name or from `make`.
      out: a new folder for the demonstrations.
      preset: a shipped configuration or the path of a YAML file; by default that of the task.
      variant: what is random in the initial states; None is the task's own if that is "jitter",
        else "layout".
      seed: of the initial states and of the expert.
      progress: show a progress line on stderr.
      options: sections of the configuration with the fields to change: `demos={"num": 24}`.

    Raises:
      DemoError: the task has no expert, the expert fails too often, or the folder exists.

    Example:
      demos = record_demos("match_regions", "demos", preset="quickstart")
    """
    config = settings.for_task(task, preset, options, 0, None)
    with Progress(shown=progress) as shown:
        return make_demos.make(config, Path(out), shown, variant=variant, seed=seed)
