"""The reward of a run as the progress of each frame of the LeRobot dataset that it learned from:
`gril export RUN --progress DATASET --out sarm_progress.parquet`."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from gril_jax import reward
from gril_jax.demos.demo import Demo
from gril_jax.demos.formats import lerobot
from gril_jax.errors import ConfigError
from gril_jax.export.lerobot_progress import Trace, write_progress
from gril_jax.runs import places, run_dir
from gril_jax.workflows import export_reward
from gril_jax.workflows.build import demonstrations, learners, setup


def main(folder: Path, out: Path, dataset: Path, *, echo: Callable[[str], None] = print) -> None:
    """Writes the file. Frames of episodes that the run does not have, have no progress.

    Raises ConfigError if it is no LeRobot dataset, and DemoError if the run's videos are others.
    """
    if not lerobot.is_dataset(dataset):
        raise ConfigError(f"--progress is {dataset}, but must be the folder of a LeRobot dataset")
    opened, config = lerobot.opened(dataset), run_dir.read_config(folder)
    learned = export_reward.of_run(folder)
    source = Path(config.demos.path or folder / "demos")
    places.require(source, "the rewards are those along these videos")
    demos = demonstrations.chosen(config, setup.task_of(config.env), source)
    learner, hyper = learners.learner(config, demos), setup.pretrain_hyper(config)
    names = [name for split in demos.names.values() for name in split]
    films = learner.films(names)
    latents = learner.latents(learned.params.encoder, films, hyper)
    along = np.asarray(reward.latent_reward(learned.params, latents))
    entries = zip(names, along, np.asarray(films.length), strict=True)
    fps = demos.demo_set.fps
    traces = {n: Trace(x[:end], _times(demos.demo_set[n], fps)) for n, x, end in entries}
    known, frames = write_progress(opened, out, traces, source=str(folder))
    echo(f"wrote {out}: progress of {known:,} of {frames:,} frames")


def _times(entry: Demo, fps: float) -> np.ndarray:
    """Seconds of each frame in the imported video."""
    return np.arange(len(entry)) / fps if entry.source is None else entry.source.time
