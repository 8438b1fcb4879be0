"""Demonstrations for a task without an expert: whether there are any, and show its objects."""

from collections import Counter
from dataclasses import replace

import jax
import numpy as np

from gril_jax import envs
from gril_jax.config import RunConfig
from gril_jax.demos.demo_set import DemoSet
from gril_jax.envs import Env
from gril_jax.errors import ConfigError, DemoError

_ROUNDING = 0.01  # of half_extent, by which films of the same picture may differ


def require_demonstrations(config: RunConfig, env: Env) -> None:
    """Raises before any work if there are neither demonstrations nor an expert."""
    name = config.env.name
    expert = env.expert if config.env.is_own else envs.spec(name).demonstrate
    if config.demos.path is None and not expert:
        raise ConfigError(
            f"the task {config.env.shown_name} has no expert that could demonstrate it, so --demos "
            "must name a set: gril demos import-videos makes one of films"
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
