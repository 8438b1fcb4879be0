"""Tasks by name."""

from gril_jax.envs.magical.match_regions.task import MatchRegions
from gril_jax.envs.tabletop.shoes_in_box.task import shoes_in_box

from .base import Env

__all__ = ["make", "names"]

_TASKS = {"match_regions": MatchRegions, "shoes_in_box": shoes_in_box}


def names() -> tuple[str, ...]:
    """The registered tasks."""
    return tuple(_TASKS)


def make(name: str, **options) -> Env:
    """Build a task; `options` are its constructor's keyword arguments.

    Raises:
      ValueError: no task has that name, or an option is out of range.
    """
    if name not in _TASKS:
        raise ValueError(f"task {name!r} is not one of {', '.join(_TASKS)}")
    return _TASKS[name](**options)
