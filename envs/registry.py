"""The table of tasks: a name, and where the task's entry is found.

A task is a folder with an entry `SPEC` in its `__init__.py`, one line of `TASKS`, and a YAML file
of its name in `configs`. A task of another package needs no line here: its name is its entry's
import path, such as "my_package.my_task:SPEC".

Nothing here imports JAX or MuJoCo, nor may a task's `__init__.py`: the command line reads entries
before it imports either. Parts of an entry are import paths, followed when they are called.
"""

import dataclasses
import inspect
import pkgutil
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from .checks import check_known, nearest

TASKS = {
    "match_regions": "gril_jax.envs.magical.match_regions:SPEC",
    "move_to_corner": "gril_jax.envs.magical.suite:MOVE_TO_CORNER",
    "move_to_region": "gril_jax.envs.magical.suite:MOVE_TO_REGION",
    "find_dupe": "gril_jax.envs.magical.suite:FIND_DUPE",
    "fix_colour": "gril_jax.envs.magical.suite:FIX_COLOUR",
    "cluster_colour": "gril_jax.envs.magical.suite:CLUSTER_COLOUR",
    "cluster_shape": "gril_jax.envs.magical.suite:CLUSTER_SHAPE",
    "make_line": "gril_jax.envs.magical.suite:MAKE_LINE",
    "shoes_in_box": "gril_jax.envs.tabletop.shoes_in_box:SPEC",
}


@dataclasses.dataclass(frozen=True)
class TaskSpec:
    """A task's entry: where its parts are, and what must be known before they are imported."""

    make: str
    """Import path of its constructor: keyword options -> `Env`."""
    demonstrate: str
    """Import path of its scripted expert, a `gril_jax.envs.base.Demonstrate`."""
    rewards: tuple[str, ...]
    """Its own rewards, for the option `reward`; the first is the constructor's default."""
    bench_settings: tuple[Mapping[str, Any], ...] = ({},)
    """Options of the constructor that `gril bench env` compares."""
    bench_envs: int = 4096
    """Environments that `gril bench env` steps together on a GPU."""
    many_starts: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """By a value of the option `variant` with a single start: the variant with many starts from
    which success is counted in its place. A variant that is not here stands for itself."""
    elsewhere: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """By a variant: the one whose starts lie further away, to be told beside it. Variants that are
    named here or in `many_starts` differ in `reset` alone."""
    steps_in_mjx: bool = False
    """True if MuJoCo MJX steps it, whatever its options are."""
    xla_flags: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    """Flags of XLA that it needs, by the first part of jaxlib's version: XLA aborts over others."""


def names() -> tuple[str, ...]:
    """The tasks of this package."""
    return tuple(TASKS)


def spec(name: str) -> TaskSpec:
    """The entry of a task, by its name or by the import path of a `TaskSpec`.

    Raises:
      ValueError: there is no such task.
    """
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
            f"{', '.join(TASKS)}, and any other is given as the import path of its TaskSpec, such "
            "as my_package.my_task:SPEC"
        )
    return pkgutil.resolve_name(TASKS[name])


def check(name: str, reward: str | None) -> None:
    """Raises ValueError if there is no such task, or if it has no such reward; None is any."""
    rewards = spec(name).rewards
    if reward is not None:
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
    task = spec(name)
    return Starts(variant, task.many_starts.get(variant, variant), task.elsewhere.get(variant))


def make(name: str, **options: Any) -> Any:
    """Builds a task, a `gril_jax.envs.Env`; `options` are its constructor's keyword arguments.

    Raises:
      ValueError: no task has that name, or an option is out of range.
    """
    return pkgutil.resolve_name(spec(name).make)(**options)


def demonstrate(name: str) -> Callable[..., Any]:
    """The task's scripted expert, a `gril_jax.envs.base.Demonstrate`."""
    return pkgutil.resolve_name(spec(name).demonstrate)


def options(name: str) -> frozenset[str]:
    """The options of a task's constructor, by its signature.

    Those that it passes on as `**options` are the ones of the class that it returns.
    """
    signature = inspect.signature(pkgutil.resolve_name(spec(name).make))
    parameters = [*signature.parameters.values()]
    if any(p.kind is p.VAR_KEYWORD for p in parameters):
        parameters += inspect.signature(signature.return_annotation).parameters.values()
    return frozenset(p.name for p in parameters if p.kind is p.KEYWORD_ONLY)
