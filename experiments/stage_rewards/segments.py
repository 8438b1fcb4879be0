"""The segments of films between the ends of their stages, as batches in memory.

They are those that `gril subtasks --sets True` writes as films. Shapes use B for films, T for
frames, N for objects and K for stages.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Bool, Int

from gril_jax.audit.scene_reward import Scene
from gril_jax.types import DemoBatch

from ..subtasks.ends import segments
from ..tabletop.experts import seen_for_good

_LEAST = 2  # frames of a segment


class Part(NamedTuple):
    """One stage's segments."""

    films: DemoBatch  # as films of their own, padded with their last frames
    bits: Bool[Array, "B T N"]  # activity (Eq. 4) as in the whole film, where earlier motion counts


def cut(demos: DemoBatch, bits: Bool[Array, "B T N"], ends: Int[np.ndarray, "B K"]) -> list[Part]:
    """The segments of each stage, whose ends are last frames.

    A segment begins with the last frame of the one before, the last one ends with its film. Those
    of fewer than two frames are left out.
    """
    length, size = demos.length.tolist(), demos.center.shape[1]
    spans = np.array([segments(*film) for film in zip(ends, length, strict=True)])  # (B, K, 2)
    parts = []
    for first, last in np.moveaxis(spans, 0, 2):
        kept = np.flatnonzero(last - first + 1 >= _LEAST)
        frames = np.minimum(first[:, None] + np.arange(size), last[:, None])[kept]
        film = kept[:, None]
        whole: DemoBatch = jax.tree.map(lambda x, kept=kept: jnp.asarray(x)[kept], demos)
        films = whole._replace(
            center=jnp.asarray(demos.center)[film, frames],
            size=jnp.asarray(demos.size)[film, frames],
            length=jnp.asarray((last - first + 1)[kept], jnp.int32),
        )
        parts.append(Part(films, bits[film, frames]))
    return parts


def scenes(films: DemoBatch, bits: Bool[Array, "B T N"]) -> Scene:
    """All frames of films as states, leaves (B, T, N, ...)."""
    each = jnp.broadcast_to(films.label[:, None], bits.shape)
    robot = jnp.broadcast_to(films.is_robot[:, None], bits.shape)
    return Scene(films.center, films.size, each, robot, bits)


def true_ends(stages: Stages, demos: DemoBatch, order: Int[Array, "N"]) -> np.ndarray:
    """The frames from which so many stages of the task hold for good, in time, (B, K), -1 for
    never; `order` is where films have the task's objects."""
    boxes = (np.asarray(jnp.take(x, order, axis=2)) for x in (demos.center, demos.size))
    films = zip(*boxes, demos.length.tolist(), strict=True)
    return np.stack([np.sort(seen_for_good(stages, c[:n], s[:n])) for c, s, n in films])
