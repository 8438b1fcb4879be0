"""Demonstrations of shoes in the box."""

import functools
from collections.abc import Callable

from gril_jax.envs.base import Demonstrations, Wanted
from gril_jax.envs.tabletop.demonstrations import JITTER, Expert, record
from gril_jax.envs.tabletop.task import Tabletop

from . import expert
from .task import shoes_in_box


def demonstrate(
    make: Callable[..., Tabletop], wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """The demonstrations wanted; a `gril_jax.envs.base.Demonstrate`.

    The expert plays with the task's own settings: whatever options a policy has, the demonstrations
    stay the same.
    """
    del make
    shown = Expert(expert.KINDS, expert.play, expert.as_meant)
    return record(_env(JITTER[wanted.places]), shown, wanted, tell)


@functools.lru_cache(maxsize=1)  # what is compiled for an environment serves as long as it does
def _env(jitter: float) -> Tabletop:
    return shoes_in_box(jitter=jitter)
