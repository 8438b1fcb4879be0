"""The vocabulary of a run's boxes: classes, robots, objects and units, of its task or videos."""

import dataclasses
import math
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from gril_jax.config import RunConfig
from gril_jax.config.task import NO_TASK
from gril_jax.demos import schema
from gril_jax.demos.demo_set import DemoSet, load_demo_set
from gril_jax.envs import Env
from gril_jax.errors import RunError
from gril_jax.runs.reading import read_phases

from . import setup

PRESET = "own_videos"  # of sets without a task
_TOGETHER = 4  # videos of a batch, at most
_WINDOW = 4.0  # seconds that a displacement is measured over


class Vocabulary(NamedTuple):
    """The meaning of a label, a length and a frame."""

    classes: tuple[str, ...]  # a label is an index into them
    robots: tuple[str, ...]  # those that are the robot, or a person
    objects: tuple[str, ...]  # class of each object of the usual scene, in order
    half_extent: float  # half the width of what a frame shows, in the unit
    unit: str  # of lengths, in words
    fps: float | None = None  # frames per second


def of_run(config: RunConfig, folder: Path) -> Vocabulary:
    """The vocabulary of a run with a reward: its task's words, and the lengths of its videos."""
    found = _of_films(config, folder)
    if config.env.name == NO_TASK and found is None:
        raise RunError(f"{folder} does not say which classes its videos have")
    return with_task(config, found)


def with_task(config: RunConfig, films: Vocabulary | None) -> Vocabulary:
    """The words of a configuration's task with the videos' lengths; without a task, theirs."""
    if config.env.name == NO_TASK:
        return films
    words = of_task(setup.make_env(config.env, training=False), config.env.name)
    if films is None:
        return words
    return words._replace(half_extent=films.half_extent, unit=films.unit, fps=films.fps)


def of_task(env: Env, name: str) -> Vocabulary:
    """The vocabulary of a task's own boxes."""
    objects = jax.jit(lambda key: env.reset(key).objects)(jax.random.key(0))
    names = tuple(env.classes[i] for i in np.asarray(objects.label))
    flags = zip(names, np.asarray(objects.is_robot), strict=True)
    robots = tuple(sorted({name for name, flag in flags if flag}))
    unit, rate = unit_of_task(name), float(env.control_hz)
    return Vocabulary(tuple(env.classes), robots, names, float(env.half_extent), unit, rate)


def unit_of_task(name: str) -> str:
    """The unit of a task's lengths, in words."""
    return f"world units of {name}"


def of_set(demo_set: DemoSet, task: str) -> Vocabulary:
    """The vocabulary of a demonstration set's boxes; an older set's are in its task's unit."""
    first = demo_set[0].tracks
    order = np.lexsort((first.center[0, :, 0], first.label))
    objects = tuple(demo_set.classes[i] for i in first.label[order])
    unit = demo_set.unit or unit_of_task(task)
    return Vocabulary(
        demo_set.classes, demo_set.robots, objects, demo_set.half_extent, unit, demo_set.fps
    )


def _of_films(config: RunConfig, folder: Path) -> Vocabulary | None:
    """As the run has noted it; of an older run, as its demonstration set says, if that is there."""
    noted = read_phases(folder).finished.get("demos", {})
    if "classes" in noted:
        fields = {name: noted[name] for name in Vocabulary._fields}
        return Vocabulary(**{k: tuple(v) if isinstance(v, list) else v for k, v in fields.items()})
    source = Path(config.demos.path or folder / "demos")
    if not (source / schema.HEADER).is_file():
        return None
    return of_set(load_demo_set(source), config.env.name)


def fitted_to_set(config: RunConfig, demos: DemoSet) -> RunConfig:
    """The configuration with what depends on the set.

    Boxes that jitter need a rule that does not take jitter for motion. Without a task, units and
    frame rate are the set's own, too.
    """
    pool = config.pool
    if demos.noise is not None and pool.noise is None:
        pool = dataclasses.replace(pool, noise=demos.noise)
    config = dataclasses.replace(config, pool=pool)
    if config.env.name != NO_TASK:
        return config
    good = sum(demo.outcome != "failure" for demo in demos)
    together = max(2, min(_TOGETHER, good - math.ceil(good / 4)))
    window = max(1, round(_WINDOW * demos.fps))
    return dataclasses.replace(
        config,
        encoder=dataclasses.replace(config.encoder, length_unit=demos.half_extent),
        pool=dataclasses.replace(config.pool, window=window),
        pretrain=dataclasses.replace(config.pretrain, num_videos=together),
    )
