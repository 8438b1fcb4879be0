"""Inputs of the front door's functions: demonstrations, and tasks by name or as objects."""

import contextlib
import dataclasses
import inspect
import io
import json
import os
import warnings
import weakref
from typing import Any

from gril_jax import envs
from gril_jax.config import EnvConfig
from gril_jax.demos import importing
from gril_jax.demos.demo_set import DemoSet, load_demo_set
from gril_jax.envs import Env, registry
from gril_jax.envs.user_tasks import files
from gril_jax.errors import ConfigError
from gril_jax.runs.progress import Progress
from gril_jax.types import checked

_PRESET = "own_task"  # of a user's task


@checked
def import_videos(
    folder: str | os.PathLike,
    out: str | os.PathLike | None = None,
    *,
    progress: bool = True,
    **options: Any,
) -> DemoSet:
    """The demonstrations of a folder of videos, with the boxes beside them, or those that a
    detector finds.

    Args:
      folder: videos with a file of boxes each, MAGICAL's `*.pkl.gz` files, or a LeRobot dataset.
      out: a folder to write the demonstrations to; None keeps them in memory.
      progress: show a progress line on stderr.
      options: those of `gril_jax.demos.importing.import_videos`, such as `robot=["hand"]`, the
        classes that belong to a robot or a person, `detect="cup, hand"`, what to find in videos
        without boxes, `boxes`, `fps` and `half_extent`.

    What is doubtful in a video is a warning; `notes` of the result has all that was repaired.

    Raises:
      DemoError: no videos, a damaged one, or boxes that are missing, malformed or do not fit.

    Example:
      demos = import_videos("videos", robot=["hand"])
    """
    with Progress(shown=progress) as shown:
        options |= {"progress": shown.steps("reading", "videos"),
                    "writing": shown.steps("writing", "videos"),
                    "detecting": shown.steps("detecting", "frames")}  # fmt: skip
        made = importing.import_videos(folder, out, **options)
    for line in made.notes.splitlines():
        if line.startswith("doubtful: "):
            warnings.warn(line, stacklevel=3)  # of the caller: `checked` is in between
    return made


@checked
def load_demos(folder: str | os.PathLike) -> DemoSet:
    """The demonstrations in a folder of `import_videos` or of `gril demos`.

    Raises:
      DemoError: there are none, or a file is missing or was changed.

    Example:
      demos = load_demos("mine")
    """
    return load_demo_set(folder)


_MADE: weakref.WeakKeyDictionary[Any, tuple[str, dict[str, Any]]] = weakref.WeakKeyDictionary()


@checked
def make(name: str, **options: Any) -> Env:
    """A task: an environment with pure functions `reset(key)` and `step(state, action)`.

    Args:
      name: one of `gril_jax.envs.registry.names()`, the file of a task of yours and the function
        that makes it, such as "my_task.py:make", or an entry point of `gril_jax.tasks`.
      options: keyword arguments of the task's constructor, such as `variant="jitter"`.

    Raises:
      ValueError: no task has that name, or an option is out of range.

    Example:
      task = make("match_regions", variant="jitter")
      state = jax.jit(task.reset)(jax.random.key(0))
    """
    with contextlib.redirect_stdout(io.StringIO()):  # mjx reports parts that are not installed
        task = envs.make(name, **options)
    with contextlib.suppress(TypeError):  # one that takes no weak reference is an object like any
        _MADE[task] = str(files.reference(name)) if files.is_reference(name) else name, options
    return task


def preset(task: Any) -> str:
    """The name of the configuration that a task is trained with unless another is named; a
    ConfigError for what is no task."""
    name = task if isinstance(task, str) else _made(task)[0]
    if not name or registry.is_own(name):
        return _PRESET
    return registry.spec(name).config or name


def _made(task: Any) -> tuple[str, dict[str, Any]]:
    """The name and the options that `make` was given; of another object none."""
    if not callable(getattr(task, "reset", None)):
        raise ConfigError(f"task is {task!r:.60}, but must be a name, or have reset and step")
    return _MADE.get(task, ("", {}))


def env_config(task: Any, usual: EnvConfig) -> EnvConfig:
    """The section `env` of a task: by its name as a preset has it, one from `make` by its name and
    options, and any other object as it is; a ConfigError for what is no task."""
    if isinstance(task, str):
        return dataclasses.replace(usual, name=_named(task))
    known = [field.name for field in dataclasses.fields(EnvConfig) if field.name != "options"]
    name, given = _made(task)
    if not name or (registry.is_own(name) and not _as_text(given)):
        return EnvConfig(name=registry.lend(task))
    if registry.is_own(name):
        return _own_config(name, given)
    values = {option: _default(name, option) for option in registry.options(name)} | given
    further = tuple(f"{n}={json.dumps(x)}" for n, x in given.items() if n not in known)
    return EnvConfig(name=name, options=further, **{n: x for n, x in values.items() if n in known})


def _own_config(name: str, given: dict[str, Any]) -> EnvConfig:
    """The section `env` of a user's task that `make` has made. Its options may have the names of
    fields, but what is varied and the variant are asked for by the fields."""
    varies = "varied_starts" in registry.options(name)
    varied = given.get("varied_starts", _default(name, "varied_starts") if varies else 0.0)
    variant = given.get("variant", EnvConfig.variant)
    options = {n: x for n, x in given.items() if n != "varied_starts"}
    if variant != EnvConfig.variant:
        del options["variant"]
    written = tuple(f"{n}={json.dumps(x)}" for n, x in options.items())
    return EnvConfig(name=name, variant=variant, varied_starts=varied, options=written)


def _named(task: str) -> str:
    """A task's name, with the whole path of a file, which the caller has named."""
    try:
        return str(files.name(task)) if files.is_reference(task) else task
    except ValueError as error:
        raise ConfigError(f"task: {error}") from error


def _as_text(options: dict[str, Any]) -> bool:
    """True if a configuration can hold the options."""
    try:
        return json.loads(json.dumps(options)) == options
    except (TypeError, ValueError):
        return False


def _default(name: str, option: str) -> Any:
    """The value that a task's constructor takes for an option that it is not given."""
    constructor = registry.constructor(name)
    parameters = dict(inspect.signature(constructor).parameters)
    made = inspect.signature(constructor).return_annotation
    if option not in parameters and inspect.isclass(made):
        parameters |= inspect.signature(made).parameters
    return parameters[option].default
