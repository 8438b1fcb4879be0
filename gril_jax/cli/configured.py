"""The configuration of a run, as its command line asks for it.

Options are read once above the defaults; those may be of a configuration, a task or a demonstration
set that the options name, and then they are read again above these.
"""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from gril_jax.config import RunConfig
from gril_jax.config.command_line import parse
from gril_jax.config.files import sections
from gril_jax.config.run_config import Sections
from gril_jax.config.tables import REWARDS
from gril_jax.config.task import NO_TASK
from gril_jax.envs import registry
from gril_jax.errors import ConfigError, DemoError
from gril_jax.runs import run_dir, sinks

from . import own_films, own_tasks
from .arguments import echo, existing_folder
from .help_page import Page

ConfigName = Annotated[
    str | None,
    tyro.conf.Positional,
    tyro.conf.arg(metavar="CONFIG", help="A shipped configuration, or the path of a YAML file."),
]


@dataclass(frozen=True)
class RunOptions(Sections):
    """A whole configuration, and what a verb that begins runs has besides."""

    resume: str | None = None
    """Folder of a run that was cut off, to go on with bit for bit."""
    help: Annotated[bool, tyro.conf.arg(aliases=("-h",))] = False
    """The options that matter most."""
    help_all: bool = False
    """Every option, with its section's name before it."""


Given = TypeVar("Given")  # options of a verb
Options = TypeVar("Options", bound=RunOptions)


def start(given: Any, *, films_alone: bool = False) -> Sections | None:
    """The sections to read options above: those of the configuration that is named, or else of the
    one for tasks or films of one's own; None for the defaults.

    With `films_alone`, what depends on the units of a demonstration set is as its header says.
    """
    name = given.config
    header = own_films.header(given.demos.path) if films_alone else None
    if name is None and header is not None and header.get("task") not in registry.names():
        name = own_films.CONFIG
    elif name is None and registry.is_own(given.env.name):
        name = own_tasks.CONFIG
    if name is None:
        return None
    found = sections(name)
    is_of_films = header is not None and found.env.name == NO_TASK
    return own_films.with_units(found, header) if is_of_films else found


def read(
    plain: Given, args: Sequence[str], prog: str, begin: Callable[[Given], Sections | None]
) -> Given:
    """The options of a command line, above the sections that `begin` finds for those that are
    given, in place of `plain`'s. A user's own task that they name may be run from now on."""
    own_help = not hasattr(plain, "help")
    given = parse(type(plain), args, default=plain, prog=prog, add_help=own_help)
    task = own_tasks.named(given.env.name)
    below = begin(given)
    if below is not None:
        known = {f.name: getattr(below, f.name) for f in dataclasses.fields(below)}
        mine = {name: value for name, value in known.items() if hasattr(plain, name)}
        default = dataclasses.replace(plain, **mine)
        given = parse(type(plain), args, default=default, prog=prog, add_help=own_help)
    if task is not None:
        given = dataclasses.replace(given, env=dataclasses.replace(given.env, name=task))
    return given


def read_run(
    plain: Options,
    args: Sequence[str],
    page: Page,
    begin: Callable[[Options], Sections | None] = start,
) -> Options:
    """`read` for options with a short help, which is printed where it is asked for."""
    given = read(plain, args, page.prog, begin)
    if given.help_all:
        parse(page.schema, ["--help"], prog=page.prog, description=page.about)
    if given.help:
        echo(page.text(given), end="")
        raise SystemExit(0)
    return given if given.resume is not None else own_films.with_noise(given)


def new_run(given: Sections, prog: str, *, films_alone: bool = False) -> RunConfig:
    """The checked configuration of a new run; with `films_alone` it may be one without a task.

    Raises a ConfigError, DemoError or RunError if it lacks what it needs, or its folder exists.
    """
    config = RunConfig.of(_with_reward(given))
    own_tasks.require(config.env)
    if config.env.name == NO_TASK and not films_alone:
        raise ConfigError(
            f"env.name is {NO_TASK}, but {prog} needs a task to play: a reward from films alone is "
            "learned by gril pretrain"
        )
    if config.env.name == NO_TASK and config.demos.path is None:
        raise ConfigError("env.name is none, so --demos must name a demonstration set of films")
    require_surroundings(config)
    if config.run.out is not None:
        run_dir.require_new(Path(config.run.out))
    return config


def _with_reward(given: Sections) -> Sections:
    """The sections, in which a run of a reward that has no slash in its name is told as a path."""
    run = given.run
    if run.reward in REWARDS or "/" in run.reward or not Path(run.reward).exists():
        return given
    run = dataclasses.replace(run, reward=f"./{run.reward}")
    return dataclasses.replace(given, run=run)


def require_surroundings(config: RunConfig) -> None:
    """Raises if a run lacks what it needs beside its configuration."""
    sinks.require_installed(config.run.sinks)
    reward = config.run.reward_source
    if reward is not None and not Path(reward).exists():
        raise ConfigError(f"run.reward is {reward}, but there is no such file or run")
    if config.demos.path is not None:
        folder = existing_folder(config.demos.path)
        if not (folder / "demos.json").is_file():
            raise DemoError(f"{folder} is not a demonstration set, because it has no demos.json")
