"""The demonstrations of a run: made or found, reduced to the task's objects, split."""

import math
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from gril_jax import envs
from gril_jax.config import RunConfig
from gril_jax.demos import schema
from gril_jax.demos.demo_set import DemoSet, demo_batch, load_demo_set, select_objects
from gril_jax.envs import Env
from gril_jax.errors import ConfigError, DemoError, RunError
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.types import DemoBatch

from . import make_demos, vocabulary

_ROUNDING = 0.01  # of half_extent, by which videos of the same picture may differ


class Demonstrations(NamedTuple):
    """The demonstrations that a run learns from and is measured on."""

    demo_set: DemoSet
    names: dict[str, list[str]]  # "train", "validation", "failure" and "teaching failure"
    trimmed: int  # frames cut from the static ends, in all

    def batch(self, split: str) -> DemoBatch:
        """The demonstrations of one split, which must not be empty."""
        return demo_batch(self.demo_set, self.names[split])


def announced(config: RunConfig) -> str | None:
    """A sentence on the scripted demonstrations that a run makes; None if it has a set."""
    if config.demos.path is not None:
        return None
    return (
        f"no --demos is given, so {config.demos.num} scripted demonstrations of "
        f"{config.env.shown_name} are made first"
    )


def gather_once(
    config: RunConfig, env: Env | None, run: run_dir.RunDir, progress: Progress
) -> Demonstrations:
    """Runs `gather` into the run's folder, as its first phase, and notes what the boxes are.

    Raises RunError if the set is not the one that the run began with.
    """
    demos = gather(config, env, run.path / "demos", progress)
    source = Path(config.demos.path or run.path / "demos")
    header = source / schema.HEADER
    digest = schema.digest(header)
    begun = run.finished_phase("demos")
    if begun is None:
        words = vocabulary.of_set(demos.demo_set, config.env.name)
        noted = {"sha256": digest, **words._asdict()}
        run.finish_phase("demos", noted, [] if config.demos.path else [header])
    elif begun["sha256"] != digest:
        raise RunError(
            f"the demonstration set {source} has been changed since the run in {run.path} began, "
            "so the run cannot go on with it"
        )
    return demos


def gather(config: RunConfig, env: Env | None, folder: Path, progress: Progress) -> Demonstrations:
    """Loads `config.demos.path`, or the set in `folder`, which is made first if missing.

    Objects that the task does not have are left out, so that a task with fewer blocks can learn
    from videos with more. Without a task all objects are kept. Failures never train the encoder.
    Raises DemoError if the set cannot be used for this task.
    """
    if env is None and config.demos.path is None:
        raise DemoError("env.name is none, but no videos are given: name a set with --demos")
    # A set appears whole: one that is there is the one that these settings make.
    if config.demos.path is None and not (folder / schema.HEADER).is_file():
        for left in folder.parent.glob(f".{folder.name}.*"):  # by a process that was killed
            shutil.rmtree(left, ignore_errors=True)
        make_demos.make(config, folder, progress)
    source = Path(config.demos.path or folder)
    return chosen(config, env, source)


def require_usable(config: RunConfig, env: Env | None, *, begun: bool = False) -> None:
    """Raises ConfigError before any work if a task has neither demonstrations nor an expert.

    Also if the set of a run that has not begun cannot be used."""
    if config.demos.path is None and env is not None:
        expert = env.expert if config.env.is_own else envs.spec(config.env.name).demonstrate
        if not expert:
            raise ConfigError(
                f"the task {config.env.shown_name} has no expert that could demonstrate it, so "
                "--demos must name a set: gril demos import-videos makes one of videos"
            )
    if config.demos.path is not None and not begun:
        try:
            chosen(config, env, Path(config.demos.path))
        except DemoError as error:
            raise ConfigError(str(error)) from None


def chosen(config: RunConfig, env: Env | None, source: Path) -> Demonstrations:
    """The demonstrations of the set in a folder, reduced and split as `gather` has it."""
    own = config.demos.path is not None
    return of_set(config, env, load_demo_set(source), own=own, source=source)


def of_set(
    config: RunConfig,
    env: Env | None,
    demo_set: DemoSet,
    *,
    own: bool = True,
    source: Any = "demos",
) -> Demonstrations:
    """The demonstrations of a set, reduced and split; of somebody's `own` videos a quarter at the
    most is kept aside. Errors are those of `gather`, in which `source` names the set."""
    if env is not None:
        if config.env.is_own:
            demo_set = fitted(demo_set, env, config.env.shown_name)
        _require_fitting(demo_set, env, config.env.shown_name)
        demo_set = select_objects(demo_set, _objects(env))
    good = [demo for demo in demo_set if demo.outcome != "failure"]
    if len(good) < 3:
        raise DemoError(f"{source}: holds {len(good)} demonstrations, but at least 3 are needed")
    held = config.demos.num_validation
    if own:
        held = min(held, math.ceil(len(good) / 4))
    if len(good) - held < config.pretrain.num_videos:
        raise DemoError(
            f"{source}: {len(good) - held} demonstrations are left to train on, but "
            f"pretrain.num_videos is {config.pretrain.num_videos} and must be at most that"
        )
    if len(good) - held < config.loss.goals:
        raise DemoError(
            f"{source}: {len(good) - held} demonstrations are left to train on, but loss.goals is "
            f"{config.loss.goals} and must be at most that"
        )
    trimmed = sum(demo.trimmed for demo in demo_set)
    return Demonstrations(demo_set, demo_set.split(held), trimmed)


def _objects(env: Env) -> tuple[str, ...]:
    """The names of a task's objects: its classes, where it does not say more."""
    return tuple(getattr(env, "object_names", env.classes))


def _require_fitting(demo_set: DemoSet, env: Env, task: str) -> None:
    """Raises DemoError if the set has other classes than the task, or lengths of another unit."""
    source = demo_set.folder
    if tuple(demo_set.classes) != tuple(env.classes):
        raise DemoError(
            f"{source}: its class names are not those of {task}; import the videos "
            "again for this task"
        )
    known = demo_set.unit in (None, vocabulary.unit_of_task(task))  # None: of an older version
    if not known and not math.isclose(demo_set.half_extent, env.half_extent, rel_tol=_ROUNDING):
        raise DemoError(
            f"{source}: a frame shows {demo_set.half_extent:g} {demo_set.unit} to each side of its "
            f"middle, but those of {task} show {env.half_extent:g}; import the videos again with "
            f"--half-extent {env.half_extent:g}"
        )


def fitted(demo_set: DemoSet, env: Env, task: str) -> DemoSet:
    """The demonstrations with the task's labels; a DemoError if they show other objects."""
    source = demo_set.folder
    if {*demo_set.classes} != {*env.classes}:
        raise DemoError(
            f"{source}: its classes are {', '.join(sorted(demo_set.classes))}, but those of {task} "
            f"are {', '.join(sorted(env.classes))}; both must use the same words"
        )
    if abs(demo_set.half_extent / env.half_extent - 1) > _ROUNDING:
        raise DemoError(
            f"{source}: a frame shows {demo_set.half_extent:g} to each side of its middle, but "
            f"half_extent of {task} is {env.half_extent:g}; both must be in the same unit"
        )
    objects = jax.jit(lambda key: env.reset(key).objects)(jax.random.key(0))
    names = [env.classes[i] for i in np.asarray(objects.label)]
    robots = {names[i] for i in np.flatnonzero(objects.is_robot)}
    if robots != {*demo_set.robots} & {*demo_set.classes}:
        said = ", ".join(sorted({*demo_set.robots} & {*demo_set.classes})) or "none"
        raise DemoError(
            f"{source}: the robot is {said} there, but {', '.join(sorted(robots)) or 'none'} in "
            f"{task}"
        )
    for demo in demo_set:
        shown = demo_set.objects(demo)
        if Counter(shown) != Counter(names):
            raise DemoError(
                f"{source}: {demo.name!r} shows {', '.join(sorted(shown))}, but {task} "
                f"has {', '.join(sorted(names))}"
            )
    order = np.array([env.classes.index(name) for name in demo_set.classes], np.int32)
    demos = tuple(
        replace(demo, tracks=demo.tracks._replace(label=order[demo.tracks.label]))
        for demo in demo_set
    )
    return replace(demo_set, classes=tuple(env.classes), demos=demos)
