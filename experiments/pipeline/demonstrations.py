"""The demonstrations of a run: made or found, reduced to the task's objects, split."""

import math
import shutil
from pathlib import Path
from typing import NamedTuple

from gril_jax.envs import Env

from gril_jax.config import RunConfig
from gril_jax.demos import schema
from gril_jax.demos.demo_set import DemoSet, demo_batch, load_demo_set, select_objects
from gril_jax.errors import DemoError, RunError
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.types import DemoBatch

from . import make_demos, own_task


class Demonstrations(NamedTuple):
    """The demonstrations that a run learns from and is measured on."""

    demo_set: DemoSet
    names: dict[str, list[str]]  # "train", "validation" and "failure" to demonstrations
    trimmed: int  # frames cut from the static tails, in all

    def batch(self, split: str) -> DemoBatch:
        """The demonstrations of one split, which must not be empty."""
        return demo_batch(self.demo_set, self.names[split])


def gather_once(
    config: RunConfig, env: Env, run: run_dir.RunDir, progress: Progress
) -> Demonstrations:
    """Runs `gather` into the run's folder, as its first phase.

    Raises RunError if the set is not the one that the run began with.
    """
    demos = gather(config, env, run.path / "demos", progress)
    source = Path(config.demos.path or run.path / "demos")
    header = source / schema.HEADER
    digest = schema.digest(header)
    begun = run.finished_phase("demos")
    if begun is None:
        run.finish_phase("demos", {"sha256": digest}, [] if config.demos.path else [header])
    elif begun["sha256"] != digest:
        raise RunError(
            f"the demonstration set {source} has been changed since the run in {run.path} began, "
            "so the run cannot go on with it"
        )
    return demos


def gather(config: RunConfig, env: Env, folder: Path, progress: Progress) -> Demonstrations:
    """Loads `config.demos.path`, or the set in `folder`, which is made first if missing.

    Objects that the task does not have are left out, so that a task with fewer blocks can learn
    from videos with more. Failures never train the encoder. Raises DemoError if the set cannot be
    used for this task.
    """
    # A set appears whole: one that is there is the one that these settings make.
    if config.demos.path is None and not (folder / schema.HEADER).is_file():
        for left in folder.parent.glob(f".{folder.name}.*"):  # by a process that was killed
            shutil.rmtree(left, ignore_errors=True)
        make_demos.make(config, folder, progress)
    source = Path(config.demos.path or folder)
    demo_set = load_demo_set(source)
    if config.env.is_own:
        demo_set = own_task.fitted(demo_set, env, config.env.shown_name)
    if tuple(demo_set.classes) != tuple(env.classes):
        raise DemoError(
            f"{source}: its class names are not those of {config.env.name}; import the videos "
            "again for this task"
        )
    wanted = ("goal", "robot", *env.blocks) if hasattr(env, "blocks") else env.classes
    demo_set = select_objects(demo_set, tuple(wanted))
    good = [e.name for e in demo_set.entries if e.outcome != "failure"]
    if len(good) < 3:
        raise DemoError(f"{source}: holds {len(good)} demonstrations, but at least 3 are needed")
    held = config.demos.num_validation
    if config.demos.path is not None:  # of somebody's own videos a quarter at the most
        held = min(held, math.ceil(len(good) / 4))
    if len(good) - held < config.pretrain.num_videos:
        raise DemoError(
            f"{source}: {len(good) - held} demonstrations are left to train on, but "
            f"pretrain.num_videos is {config.pretrain.num_videos} and must be at most that"
        )
    names = {
        "train": good[: len(good) - held],
        "validation": good[len(good) - held :],
        "failure": [e.name for e in demo_set.entries if e.outcome == "failure"],
    }
    return Demonstrations(demo_set, names, sum(e.trimmed for e in demo_set.entries))
