"""The table of tasks: a name, and where the task's entry is found.

A task has an entry in the `__init__.py` of its folder or of the one above, one line of `TASKS`, and
a YAML file of its name in `configs`. A task of another package needs no line here: its name is its
entry's import path, such as "my_package.my_task:SPEC". One's own is a function that makes it: of a
file, "my_task.py:make", or of an installed package that lists it as an entry point of
`ENTRY_POINTS`.

Nothing here imports JAX or MuJoCo, nor may a task's `__init__.py`: the command line reads entries
before it imports either. Parts of an entry are import paths, followed when they are called.
"""

import contextlib
import dataclasses
import functools
import inspect
import pkgutil
from collections.abc import Callable, Mapping
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.envs.user_tasks import files

from .checks import check_known, nearest

ENTRY_POINTS = "gril_jax.tasks"  # of functions that make a task

TASKS = {
    "match_regions": "gril_jax.envs.magical.match_regions:SPEC",
    "move_to_corner": "gril_jax.envs.magical.suite:MOVE_TO_CORNER",
    "move_to_region": "gril_jax.envs.magical.suite:MOVE_TO_REGION",
    "find_dupe": "gril_jax.envs.magical.suite:FIND_DUPE",
    "fix_colour": "gril_jax.envs.magical.suite:FIX_COLOUR",
    "cluster_colour": "gril_jax.envs.magical.suite:CLUSTER_COLOUR",
    "cluster_shape": "gril_jax.envs.magical.suite:CLUSTER_SHAPE",
    "make_line": "gril_jax.envs.magical.suite:MAKE_LINE",
    "match_regions_magical": "gril_jax.envs.magical.suite:MATCH_REGIONS_MAGICAL",
    "shoes_in_box": "gril_jax.envs.tabletop:SHOES_IN_BOX",
    "rubbish_in_bin": "gril_jax.envs.tabletop:RUBBISH_IN_BIN",
    "umbrella_out": "gril_jax.envs.tabletop:UMBRELLA_OUT",
    "item_in_drawer": "gril_jax.envs.tabletop:ITEM_IN_DRAWER",
    "shoes_out_of_box": "gril_jax.envs.tabletop:SHOES_OUT_OF_BOX",
    "empty_container": "gril_jax.envs.tabletop:EMPTY_CONTAINER",
}


@dataclasses.dataclass(frozen=True)
class TaskSpec:
    """A task's entry: where its parts are, and what must be known before they are imported."""

    make: str
    """Import path of its constructor: keyword options -> `Env`."""
    demonstrate: str
    """Import path of its scripted expert, a `gril_jax.envs.base.Demonstrate`; empty: none."""
    rewards: tuple[str, ...]
    """Its own rewards, for the option `reward`; the first is the constructor's default."""
    bench_envs: int = 4096
    """Environments that `gril bench env` steps together on a GPU."""
    many_starts: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """By a value of the option `variant` with a single start: the variant with many starts from
    which success is counted in its place. A variant that is not here stands for itself."""
    elsewhere: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """By a variant: the one whose starts lie further away, to be told beside it. Variants that are
    named here or in `many_starts` differ in `reset` alone."""
    varied: str = ""
    """Its varied training starts (`varied_starts`) in words; empty if it has none."""
    hints: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """Hints of the goal that the policy sees, in words, by the value of `observation` that gives
    them; those of "" are in every observation."""
    config: str = ""
    """The configuration with its settings, if it is not the one of its name."""
    steps_in_mjx: bool = False
    """True if MuJoCo MJX steps it, whatever its options are."""
    xla_flags: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """Flags of XLA that it needs, by the first part of jaxlib's version: XLA aborts over others."""


def names() -> tuple[str, ...]:
    """The tasks of this package."""
    return tuple(TASKS)


_LENT: dict[str, Any] = {}  # tasks that exist already, by their names here


def lend(task: Any) -> str:
    """A name for a task that exists already: `build` gives it back, and takes no options.

    It is kept for as long as the process runs.
    """
    name = next((name for name, known in _LENT.items() if known is task), None)
    if name is None:
        name = f"{type(task).__name__}-{len(_LENT)}"
        _LENT[name] = task
    return name


def is_own(name: str) -> bool:
    """True if a task is a user's own, and has no `TaskSpec`: a function of a file, an entry point
    or an object that was lent."""
    known = files.is_reference(name) or name in _LENT
    return known or (name not in TASKS and name in _installed())


def shown_name(name: str) -> str:
    """A task's name for people: of a file its stem."""
    return files.reference(name).file.stem if files.is_reference(name) else name


def digest(name: str) -> str | None:
    """The SHA-256 of the file of a task of one's own; None of one that is no file, or is gone."""
    try:
        return files.digest(name) if files.is_reference(name) else None
    except ValueError:
        return None


def _installed() -> dict[str, metadata.EntryPoint]:
    return {point.name: point for point in metadata.entry_points(group=ENTRY_POINTS)}


# What holds for any: whether MJX steps it is not known before it is run.
_OWN = TaskSpec(make="", demonstrate="", rewards=(), steps_in_mjx=True)


def spec(name: str) -> TaskSpec:
    """The entry of a task, by its name or by the import path of a `TaskSpec`.

    One's own has one without paths; its file is not run here.

    Raises:
      ValueError: there is no such task.
    """
    if files.is_reference(name):
        files.reference(name)
        return _OWN
    if is_own(name):
        return _OWN
    if ":" in name:
        try:
            found = pkgutil.resolve_name(name)
        except (ImportError, AttributeError, ValueError) as error:
            raise ValueError(f"there is no task {name!r}: {error}") from error
        if not isinstance(found, TaskSpec):
            raise ValueError(f"{name} is a {type(found).__name__}, but a task is a TaskSpec")
        return found
    if name not in TASKS:
        raise ValueError(
            f"there is no task {name!r}{nearest(name, [*TASKS])}: the tasks are "
            f"{', '.join([*TASKS, *_installed()])}, and any other is given as the file of a "
            "function that makes it, my_task.py:make, or as the import path of its TaskSpec, "
            "my_package.my_task:SPEC"
        )
    return pkgutil.resolve_name(TASKS[name])


def check(name: str, reward: str | None) -> None:
    """Raises ValueError if there is no such task, or if it has no such reward; None is any."""
    rewards = spec(name).rewards
    if reward is not None and not is_own(name):
        check_known("reward", reward, rewards)


class Starts(NamedTuple):
    """Variants of a task that a policy is evaluated from."""

    own: str | None  # None where the task has no variants
    many: str | None  # success is counted over its starts; the own one if that has many
    elsewhere: str | None  # None where there is no other


def starts(name: str, variant: str) -> Starts:
    """The variants to evaluate from if a task is configured with this one."""
    if "variant" not in options(name):
        return Starts(None, None, None)
    task = spec(
        name
    )  # of one's own without other variants: success is counted in the one asked for
    return Starts(variant, task.many_starts.get(variant, variant), task.elsewhere.get(variant))


def make(name: str, **options: Any) -> Any:
    """Builds a task, a `gril_jax.envs.Env`; `options` are its constructor's keyword arguments.

    Who calls this names the task: the file of one's own is run.

    Raises:
      ValueError: no task has that name, an option is out of range, or one's own is not as it must
        be.
    """
    if files.is_reference(name):
        files.name(name)
    return build(name, options)


def build(name: str, options: Mapping[str, Any]) -> Any:
    """`make` for a name out of a configuration: the file of one's own must have been named."""
    maker = constructor(name)
    if not is_own(name):
        return maker(**options)
    file = _file(name)
    said = getattr(maker, "__name__", "make")  # a partial function has no name
    known, takes_any = _keywords(maker)
    unknown = [option for option in options if option not in known]
    if unknown and not takes_any:
        takes = f"it takes {', '.join(sorted(known))}" if known else "it takes none"
        raise ValueError(
            f"{file}: {said} has no option {unknown[0]!r}{nearest(unknown[0], [*known])}: {takes}"
        )
    with files.guarded(said, file):
        task = maker(**options)
    return import_module("gril_jax.envs.user_tasks.protocol").completed(task, file)


@functools.cache
def _entry_point(name: str) -> Callable[..., Any]:
    """The function of an installed entry point."""
    point = _installed()[name]
    try:
        made = point.load()
    except files.FAILURES as error:
        raise ValueError(
            f"the task {name!r} of {point.value} cannot be imported: {error}"
        ) from error
    if not callable(made):
        raise ValueError(f"the task {name!r}: {point.value} is no function that makes a task")
    return made


def constructor(name: str) -> Callable[..., Any]:
    """The function or class that makes a task."""
    if name in _LENT:
        return lambda: _LENT[name]
    if files.is_reference(name):
        return files.load(name)
    return _entry_point(name) if is_own(name) else pkgutil.resolve_name(spec(name).make)


def _file(name: str) -> Path:
    """The file of one's own task, for messages."""
    if files.is_reference(name):
        return files.reference(name).file
    if name in _LENT:
        return Path(type(_LENT[name]).__name__)
    with contextlib.suppress(TypeError):  # a partial function has no file
        return Path(inspect.getsourcefile(_entry_point(name)) or name)
    return Path(name)


def _keywords(constructor: Callable[..., Any]) -> tuple[frozenset[str], bool]:
    """The options that one's own constructor names, and whether it takes any others."""
    parameters = inspect.signature(constructor).parameters.values()
    named = inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
    names = frozenset(p.name for p in parameters if p.kind in named)
    return names, any(p.kind is p.VAR_KEYWORD for p in parameters)


def accepts(name: str, option: str) -> bool:
    """True if a task of one's own may be made with an option."""
    known, takes_any = _keywords(constructor(name))
    return takes_any or option in known


def demonstrate(name: str) -> Callable[..., Any]:
    """The task's scripted expert, a `gril_jax.envs.base.Demonstrate`."""
    return pkgutil.resolve_name(spec(name).demonstrate)


def options(name: str) -> frozenset[str]:
    """The options of a task's constructor, by its signature.

    Those that it passes on as `**options` are the ones of the class that it returns.
    """
    if is_own(name):
        return _keywords(constructor(name))[0]
    signature = inspect.signature(pkgutil.resolve_name(spec(name).make))
    parameters = [*signature.parameters.values()]
    if any(p.kind is p.VAR_KEYWORD for p in parameters):
        parameters += inspect.signature(signature.return_annotation).parameters.values()
    return frozenset(p.name for p in parameters if p.kind is p.KEYWORD_ONLY)
