"""The rule by which an object counts as moved: options of `gril_jax.graphs.activity` (Eq. 4).

A reward keeps the rule that it was trained with, since under another it is another reward.

>>> ActivityRule(window=20).init(jnp.zeros((3, 2))).past.shape
(20, 3, 2)
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.config.encoder import PoolConfig
from gril_jax.errors import ConfigError

from . import activity


class ActivityRule(NamedTuple):
    """Options of `activity.init` and `activity.step`, which document them. Static."""

    tau: float = PoolConfig.tau
    """Displacement that counts as motion, in diagonals of the object's box."""
    window: int = PoolConfig.window
    """Number of frames back to compare a centre with."""
    smoothing: int = PoolConfig.smoothing
    """Frames of the median filter on centres; odd."""
    noise: float | None = PoolConfig.noise
    """Standard deviation of a centre's jitter along one axis, world units."""

    def init(self, center: Float[Array, "N 2"]) -> activity.Memory:
        """Calls `activity.init` with this rule, at an episode's first frame."""
        return activity.init(center, window=self.window, smoothing=self.smoothing)

    def step(
        self, memory: activity.Memory, center: Float[Array, "N 2"], size: Float[Array, "N 2"]
    ) -> tuple[activity.Memory, Bool[Array, "N"]]:
        """Calls `activity.step` with this rule."""
        return activity.step(memory, center, size, tau=self.tau, noise=self.noise)

    def check(self) -> None:
        """Checks the ranges by tracing alone, so that no window costs memory.

        Raises:
          ConfigError: a field is out of its range.
        """
        box = jax.ShapeDtypeStruct((1, 2), jnp.float32)
        jax.eval_shape(lambda x: self.step(self.init(x), x, x), box)


PAPER = ActivityRule()

_TYPES = {
    "tau": (float, int), "window": (int,), "smoothing": (int,), "noise": (float, int, type(None)),
}  # fmt: skip
# A file must not make its reader overflow, or trace without end.
_MOST = {"tau": 1e6, "noise": 1e6, "window": 2**20, "smoothing": 99}


def from_json(fields: Any) -> ActivityRule:
    """The rule with these fields; missing ones take their defaults.

    >>> from_json({"tau": 0.01}).tau
    0.01

    Raises:
      ConfigError: a field is unknown, of another type or out of range.
    """
    if not isinstance(fields, Mapping):
        raise ConfigError(f"activity is {fields!r:.60}; it must be an object with fields.")
    for name, value in fields.items():
        if name not in _TYPES:
            known = f"to this version of gril-jax; there are {', '.join(_TYPES)}"
            raise ConfigError(f"activity.{name} is unknown {known}.")
        if type(value) not in _TYPES[name]:
            wanted = " or ".join(kind.__name__ for kind in _TYPES[name])
            raise ConfigError(f"activity.{name} is {value!r:.60}; it must be {wanted}.")
        if name in _MOST and value is not None and value > _MOST[name]:
            most = _MOST[name]
            raise ConfigError(f"activity.{name} is {value!r:.60}; it must be at most {most}.")
    rule = ActivityRule(**fields)
    rule.check()
    return rule
