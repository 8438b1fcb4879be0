"""Tasks of one's own on the command line: which file is named, and whether a run may have it.

A file that `--task` names is run. A file that only a run or a configuration names is run if this
user has named it before, with the contents that it has now; see `gril_jax.envs.user_tasks.files`.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.task import NO_TASK
from gril_jax.envs import registry
from gril_jax.envs.user_tasks import files
from gril_jax.errors import ConfigError

CONFIG = "own_task"  # where a task of one's own is named, but no configuration

_OPTION, _DIGEST = "--env.name", "--env.sha256"


def named(args: list[str]) -> list[str]:
    """The arguments, options in full, with files of tasks as absolute paths and their digests; what
    is named here may be run."""
    given: list[str] = []
    words = iter(args)
    for arg in words:
        option, equals, value = arg.partition("=")
        if option != _OPTION:
            given.append(arg)
            continue
        if not equals and (value := next(words, None)) is None:
            return args  # which its parser says better
        given.append(f"{_OPTION}={_named(value)}")
        if files.is_reference(value):
            given.append(f"{_DIGEST}={_digest(value)}")
    return given


def is_named(args: list[str]) -> bool:
    """True if the arguments, options in full, name a task of one's own."""
    for index, arg in enumerate(args):
        option, equals, value = arg.partition("=")
        if option == _OPTION:
            return registry.is_own(value if equals else "".join(args[index + 1 : index + 2]))
    return False


def noted(config: Any, args: list[str]) -> Any:
    """The configuration of a new run with the digest of its task's file, which also goes into the
    arguments; a ConfigError if the file may not be run."""
    if not files.is_reference(config.env.name):
        return config
    digest = require(config.env)
    if config.env.sha256 is None:
        args.append(f"{_DIGEST}={digest}")
    return dataclasses.replace(config, env=dataclasses.replace(config.env, sha256=digest))


def of_run(config: RunConfig, task: str | None, folder: Path) -> None:
    """Raises ConfigError if the task's file of a run may not be run, or is no longer what it was;
    `task` is the file that is named beside the run, if one is."""
    if task is not None:
        own = files.is_reference(config.env.name) and files.is_reference(task)
        if config.env.name == NO_TASK:
            raise ConfigError(f"{folder} was trained on films alone, so it has no use for --task")
        if not own and task != config.env.name:
            what = "on films alone" if config.env.name == NO_TASK else f"for {config.env.name}"
            raise ConfigError(f"{folder} was trained {what}, but --task is {task}")
        if own:
            _sentence(files.moved, config.env.name, task)
    if files.is_reference(config.env.name):
        require(config.env)


def require(env: EnvConfig) -> str:
    """The digest of the task's file; a ConfigError if it may not be run."""
    return _sentence(files.require, env.name, env.sha256)


def _named(value: str) -> str:
    return str(_sentence(files.name, value)) if files.is_reference(value) else value


def _digest(value: str) -> str:
    return _sentence(files.digest, value)


def _sentence(function: Callable[..., Any], *args: Any) -> Any:
    try:
        return function(*args)
    except ValueError as error:
        raise ConfigError(str(error)) from None
