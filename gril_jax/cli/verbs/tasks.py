"""Verbs for a task of one's own: a skeleton of it, and what is missing in it."""

import keyword
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Annotated

import tyro

from gril_jax.config import EnvConfig, MakeDemosConfig
from gril_jax.envs import registry
from gril_jax.errors import ConfigError
from gril_jax.safe_files import new_file, writing

from .. import own_tasks
from ..arguments import Work, echo, require_new_file
from ..heavy_imports import heavy_imports
from . import simple


@dataclass(frozen=True)
class _Check:
    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE:make")]
    """The task: FILE.py:FUNCTION, or an entry point of `gril_jax.tasks`."""
    options: tuple[str, ...] = field(default=())
    """Keyword arguments of its function, each NAME=VALUE."""


def _check(given: _Check) -> Work:
    name = given.task
    if not registry.is_own(name) and name not in registry.names():
        raise ConfigError(f"{name} must be a task of your own: FILE.py:FUNCTION, or an entry point")
    if not registry.is_own(name):
        raise ConfigError(f"{name} is one of gril's own tasks, which its tests check")
    name = own_tasks.named(name) or name
    env = EnvConfig(name=name, options=given.options)

    def work() -> int:
        with heavy_imports(MakeDemosConfig(env=env)):
            from gril_jax.workflows import check_task
        return check_task.main(name, env.own_options, echo=echo)

    return work


@dataclass(frozen=True)
class _New:
    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
    """Name of the task: a word such as push_puck. NAME.py and test_NAME.py are written."""
    out: str = "."
    """Folder for the files, which must exist."""


def _new(given: _New) -> Work:
    fits = given.name.isidentifier() and given.name.isascii()
    if not fits or keyword.iskeyword(given.name):
        raise ConfigError(
            f"{given.name!r:.60} must be a name such as push_puck, of letters, digits, _"
        )
    folder = resources.files("gril_jax.workflows.skeleton")
    written = (folder / f"{kind}my_task.py" for kind in ("", "test_"))
    paths = {
        Path(given.out) / file.name.replace("my_task", given.name): file.read_text(encoding="utf-8")
        for file in written
    }
    for path in paths:
        require_new_file(path)

    def work() -> None:
        for path, text in paths.items():
            with writing(path.parent), new_file(path) as file:
                file.write(text.replace("my_task", given.name).encode())
        first = f"{Path(given.out) / given.name}.py:make"
        echo(f"wrote {' and '.join(map(str, paths))}")
        echo(f"next: gril check-task {first}, then gril demos make --task {first} --out mine")

    return work


VERBS = (
    simple(
        "new-task NAME", "a task of your own that runs, to be changed, and its test", _New, _new,
        about="Write a task that runs, to be changed, and a test of it.",
    ),
    simple(
        "check-task FILE:make", "what a task of your own lacks, in sentences", _Check, _check,
        about="Say in sentences what a task of your own lacks.",
    ),
)  # fmt: skip
