"""The configuration of a run, as its command line asks for it.

Options are read first above the defaults. If they name a configuration, a task or a demonstration
set, they are read again above its settings. A set of a user's own videos has its own classes, unit
and frame rate, and the settings that depend on them.
"""

import contextlib
import dataclasses
import math
import textwrap
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import tyro

from gril_jax.config import RunConfig
from gril_jax.config.command_line import options, parse
from gril_jax.config.files import sections
from gril_jax.config.run_config import Sections
from gril_jax.config.tables import ALGORITHMS, REWARDS
from gril_jax.config.task import NO_TASK, EnvConfig
from gril_jax.envs import registry
from gril_jax.errors import ConfigError, DemoError, RunError
from gril_jax.runs import places, reading, run_dir, sinks
from gril_jax.safe_files import read_object

from .arguments import demo_set, echo, named_task, require_task

_OWN_FILMS, _OWN_TASK = "own_videos", "own_task"  # where no configuration is named
_TOGETHER = 4  # videos of a batch, at most
_WINDOW = 4.0  # seconds that a displacement is measured over

ConfigName = Annotated[
    str | None,
    tyro.conf.Positional,
    tyro.conf.arg(metavar="CONFIG", help="A shipped configuration, or the path of a YAML file."),
]

Given = TypeVar("Given")  # options of a verb


def start(given: Any, *, films_alone: bool = False) -> Sections | None:
    """The sections to read options above: those of the configuration that is named, or else of the
    one for tasks or videos of one's own; None for the defaults.

    With `films_alone`, what depends on the units of a demonstration set is as its header says.
    """
    name = given.config
    header = _header(given.demos.path) if films_alone else None
    if name is None and header is not None and header.get("task") not in registry.names():
        name = _OWN_FILMS
    elif name is None and registry.is_own(given.env.name):
        name = _OWN_TASK
    if name is None:
        return None
    found = sections(name)
    is_of_films = header is not None and found.env.name == NO_TASK
    return _with_units(found, header) if is_of_films else found


def read(
    plain: Given,
    args: Sequence[str],
    prog: str,
    about: str,
    begin: Callable[[Given], Sections | None] = start,
    *,
    policies: bool = True,
) -> Given:
    """The options of a command line, above the sections that `begin` finds for those that are
    given, in place of `plain`'s; or prints the help, without `policies` none of theirs, and exits.

    A user's own task that they name may be run from now on.
    """
    args, asked, topic = without_help(plain, args)
    given = parse(type(plain), args, default=plain, prog=prog, add_help=False)
    task = named_task(given.env.name)
    below = begin(given)
    if below is not None:
        known = {f.name: getattr(below, f.name) for f in dataclasses.fields(below)}
        mine = {name: value for name, value in known.items() if hasattr(plain, name)}
        default = dataclasses.replace(plain, **mine)
        given = parse(type(plain), args, default=default, prog=prog, add_help=False)
    if asked:
        hidden = () if policies else tuple(ALGORITHMS)
        _print_help(given, prog, about, topic, hidden)
    if task is not None:
        given = dataclasses.replace(given, env=dataclasses.replace(given.env, name=task))
    return given


def without_help(plain: Any, args: Sequence[str]) -> tuple[list[str], bool, str]:
    """The arguments without `--help`, whether it was there, and the section named after it."""
    at = next((i for i, arg in enumerate(args) if arg in ("-h", "--help")), len(args))
    after = [*args[at + 1 :]]
    topic = after.pop(0) if after and after[0] in _sections(plain) else ""
    return [*args[:at], *after], at < len(args), topic


def _sections(given: Any) -> dict[str, Any]:
    values = {one.name: getattr(given, one.name) for one in dataclasses.fields(given)}
    return {name: value for name, value in values.items() if dataclasses.is_dataclass(value)}


def _print_help(given: Any, prog: str, about: str, topic: str, hidden: Sequence[str]) -> None:
    """Prints the verb's own options, those of the first base of its class, and the names and values
    of all others; or what those of one section are. Exits."""
    if topic:
        kind = typing.get_type_hints(type(given), include_extras=True)[topic]
        one = dataclasses.make_dataclass("Topic", [(topic, kind)])
        default = one(getattr(given, topic))
        parse(one, ["--help"], default=default, prog=prog, description=f"Options of {topic}.")
    with contextlib.suppress(SystemExit):
        parse(type(given).__bases__[0], ["--help"], prog=prog, description=about)
    echo(f"All other options and their values; {prog} --help SECTION tells what those of one are.")
    names: dict[tuple[str, ...], str] = {}  # the shortest of each option
    for word, option in options(type(given)).items():
        names[option.path] = min(word, names.get(option.path, word), key=len)
    for section, values in _sections(given).items():
        if section not in hidden:
            listed = (  # no line is broken between a name and its value
                f"{names[section, x]} {_written(value)}".replace(" ", "\0")
                for x, value in vars(values).items()
            )
            how = {"initial_indent": "  ", "subsequent_indent": "  ", "break_on_hyphens": False}
            lines = textwrap.fill(", ".join(listed), 100, **how).replace("\0", " ")
            echo(f"\n{section}:\n{lines}")
    raise SystemExit(0)


def _written(value: Any) -> str:
    return " ".join(map(repr, value)) or "none" if isinstance(value, tuple) else str(value)


# --- what a new run needs


def new_run(given: Sections, prog: str, *, films_alone: bool = False) -> RunConfig:
    """The checked configuration of a new run; with `films_alone` it may be one without a task.

    Raises a ConfigError, DemoError or RunError if it lacks what it needs, or its folder exists.
    """
    if not films_alone:
        _require_scene(given, prog)
    config = RunConfig.of(_with_noise(_with_reward(given)))
    require_task(config.env)
    if config.env.name == NO_TASK and not films_alone:
        raise ConfigError(
            f"env.name is {NO_TASK}, but {prog} needs a task: a reward from videos alone is "
            "learned by gril pretrain"
        )
    if config.env.name == NO_TASK and config.demos.path is None:
        raise ConfigError("env.name is none, so --demos must name a demonstration set of videos")
    require_surroundings(config)
    if config.run.out is not None:
        run_dir.require_new(Path(config.run.out))
        run_dir.require_text(Path(config.run.out))
    return config


def _require_scene(given: Any, prog: str) -> None:
    """Raises ConfigError for videos of somebody's own without a task that simulates their scene."""
    header = _header(given.demos.path)
    if header is None or given.config is not None or given.env.name != EnvConfig().name:
        return
    if (task := header.get("task")) not in registry.names():
        made = task if isinstance(task, str) and task not in ("", NO_TASK) else "my_task"
        raise ConfigError(
            f"{prog} needs --task, the simulation in which a policy learns what "
            f"{given.demos.path} shows, such as --task {made}.py:make; gril pretrain learns the "
            "reward alone"
        )


def _with_reward(given: Sections) -> Sections:
    """The sections, in which a run of a reward that has no slash in its name is told as a path."""
    run = given.run
    if run.reward in REWARDS or "/" in run.reward or not Path(run.reward).exists():
        return given
    run = dataclasses.replace(run, reward=f"./{run.reward}")
    return dataclasses.replace(given, run=run)


def require_surroundings(config: RunConfig, resumed: Path | None = None) -> None:
    """Raises if a run, new or `resumed` in its folder, lacks what it needs beside its
    configuration."""
    sinks.require_installed(config.run.sinks)
    reward = config.run.reward_source
    if resumed is not None and reward is not None:
        kept = "reward" in reading.read_phases(resumed).finished
        reward = None if kept else str(places.find(resumed, reward, Path.exists) or reward)
    if reward is not None and not Path(reward).exists():
        raise ConfigError(f"run.reward is {reward}, but there is no such file or run")
    if config.demos.path is not None:
        demo_set(config.demos.path)


# --- what a demonstration set decides


def _header(folder: str | None) -> dict[str, Any] | None:
    """The header of a demonstration set; None where there is none, which is left to who looks at
    the set later."""
    try:
        return None if folder is None else read_object(Path(folder) / "demos.json")
    except RunError as error:
        raise DemoError(str(error)) from None
    except OSError:
        return None


def _with_noise(given: Sections) -> Sections:
    """The sections with how much the set's boxes jitter, unless they say it: else any jitter would
    count as motion."""
    found = _header(given.demos.path) or {}
    if given.pool.noise is not None or not isinstance(found.get("noise"), float):
        return given
    return dataclasses.replace(given, pool=_replaced(given.pool, noise=found["noise"]))


def _with_units(given: Sections, found: dict[str, Any]) -> Sections:
    """The sections with what depends on a set's units, as far as its header has them."""
    half, rate = found.get("half_extent"), found.get("fps")
    is_rate = type(rate) in (int, float) and 0 < rate < 1e6
    listed = found.get("demos")
    demos = [one for one in (listed if isinstance(listed, list) else ()) if isinstance(one, dict)]
    good = [one for one in demos if one.get("outcome") != "failure"]
    together = max(2, min(_TOGETHER, len(good) - math.ceil(len(good) / 4)))
    unit = float(half) if type(half) in (int, float) else None
    return dataclasses.replace(
        given,
        encoder=_replaced(given.encoder, length_unit=unit),
        pool=_replaced(given.pool, window=max(1, round(_WINDOW * rate)) if is_rate else None),
        pretrain=_replaced(given.pretrain, num_videos=together),
    )


def _replaced(section: Any, **values: Any) -> Any:
    return dataclasses.replace(section, **{k: v for k, v in values.items() if v is not None})
