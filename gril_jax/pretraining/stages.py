"""Stages of demonstrations before any reward is learned, as targets of SARM.

Objects of a video travel to where its last frame shows them. The way that is left, as a share of
the whole, is a trace that climbs from -1 to 0, and `gril_jax.subtasks` finds the steps on which the
traces of all demonstrations agree. No label is used. Shapes use B for demonstrations, T for frames,
N for objects and M for stages.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax import subtasks
from gril_jax.graphs.scene import safe_norm
from gril_jax.types import DemoBatch


class Stages(NamedTuple):
    """The stages of demonstrations."""

    times: Float[Array, "B T"]  # stages finished, and the share of the present one
    proportions: Float[Array, "M"]  # mean share of each stage in the videos; 0 for none


def way_left(demos: DemoBatch) -> Float[Array, "B T"]:
    """Minus the distance of all objects to their last places, as a share of that at the start.

    The robot does not count. 0 throughout a video in which nothing moves."""
    last = jnp.take_along_axis(demos.center, demos.length[:, None, None, None] - 1, axis=1)
    counted = (demos.present & ~demos.is_robot)[:, None]
    left = jnp.sum(jnp.where(counted, safe_norm(demos.center - last), 0.0), axis=-1)
    whole = left[:, :1]
    return -jnp.where(whole > 0, left / jnp.where(whole > 0, whole, 1.0), 0.0)


def found(demos: DemoBatch) -> Stages:
    """The stages on which demonstrations agree; one of the whole video, if they agree on none."""
    _, shared = subtasks.agreed_stages(way_left(demos), demos.length)
    none = ~shared.kept.any()
    ends = jnp.where(none, demos.length[:, None] - 1, shared.frames)
    kept = shared.kept.at[0].set(shared.kept[0] | none)
    count = jnp.sum(kept)
    # What follows the last stage belongs to its end.
    beyond = demos.center.shape[1] + 1 + jnp.arange(len(kept))
    ends = jnp.where(kept, ends, beyond)
    points = jnp.concatenate([jnp.zeros_like(ends[:, :1]), ends], axis=1).astype(jnp.float32)
    frames = jnp.arange(demos.center.shape[1], dtype=jnp.float32)
    numbers = jnp.arange(len(kept) + 1, dtype=jnp.float32)
    times = jax.vmap(lambda one: jnp.interp(frames, one, numbers))(points)
    end = jnp.take_along_axis(points, count[None, None], axis=1)
    share = jnp.where(kept, jnp.diff(points, axis=1), 0.0) / jnp.maximum(end, 1.0)
    return Stages(jnp.minimum(times, count), jnp.mean(share, axis=0))
