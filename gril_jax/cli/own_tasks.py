"""Tasks of one's own on the command line: which file is named, and whether a run may have it.

A file that `--task` names is run. A file that only a run or a configuration names is run if this
user has named it before, with the contents that it has now; see `gril_jax.envs.user_tasks.files`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.task import NO_TASK
from gril_jax.envs.user_tasks import files
from gril_jax.errors import ConfigError
from gril_jax.runs.reading import task_digest

CONFIG = "own_task"  # where a task of one's own is named, but no configuration


def named(task: str) -> str | None:
    """A file's function with its absolute path, which is named here and so may be run; None for
    tasks that are no files."""
    return str(_sentence(files.name, task)) if files.is_reference(task) else None


def of_run(config: RunConfig, task: str | None, folder: Path) -> None:
    """Raises ConfigError if the task's file of a run may not be run, or is no longer what it was;
    `task` is the file that is named beside the run, if one is."""
    if task is not None:
        own = files.is_reference(config.env.name) and files.is_reference(task)
        if config.env.name == NO_TASK:
            raise ConfigError(f"{folder} was trained on films alone, so it has no use for --task")
        if not own and task != config.env.name:
            raise ConfigError(f"{folder} was trained for {config.env.name}, but --task is {task}")
        if own:
            _sentence(files.moved, config.env.name, task)
    require(config.env, folder)


def require(env: EnvConfig, folder: Path | None = None) -> None:
    """Raises ConfigError if the task is of a file that may not be run, or that is another one than
    the run in a folder has noted."""
    if files.is_reference(env.name):
        _sentence(files.require, env.name, None if folder is None else task_digest(folder))


def _sentence(function: Callable[..., Any], *args: Any) -> Any:
    try:
        return function(*args)
    except ValueError as error:
        raise ConfigError(str(error)) from None
