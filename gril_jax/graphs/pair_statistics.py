"""Statistics of the distances between pairs of objects.

    found, count = pair_statistics(center, words, there)

Pairs of things are of five kinds: all, those whose class names share their first word (a colour),
or not, or their last one (a shape), or not. The statistics of each kind, in world units, are:

- quantiles of the distances;
- root mean squares of the pairs' distances along their narrow and their wide axis, which tell a
  line from a bend;
- the longest link, which tells one cluster from two. It is the widest gap on the way from each
  thing to its partners by way of others of the kind.

Shapes use N for objects, P for pairs, K = 5 for kinds and Q = 8 for statistics.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .scene import safe_norm

KINDS = 5
_LEVELS = 5  # quantiles: least, quarters, largest
STATISTICS = _LEVELS + 3


def pair_statistics(
    center: Float[Array, "N 2"], words: Int[Array, "N 2"], there: Bool[Array, "N"]
) -> tuple[Float[Array, "K Q"], Int[Array, "K"]]:
    """Statistics of all pairs of what is there, and the number of pairs of each kind.

    `words` are the first and the last word of each object's class name. Without pairs of a kind its
    statistics are 0.
    """
    num = len(center)
    if num < 2:  # as for a task with one block, whose reward leaves the robot out
        return jnp.zeros((KINDS, STATISTICS)), jnp.zeros(KINDS, jnp.int32)
    one, other = jnp.triu_indices(num, 1)
    way = center[one] - center[other]
    distance = safe_norm(way)
    same = (words[one] == words[other]).T  # (2, P)
    kinds = jnp.stack([same[0] | True, same[0], ~same[0], same[1], ~same[1]])
    kinds = kinds & there[one] & there[other]
    count = kinds.sum(axis=1)
    each = jax.vmap(lambda kind, n: _levels(distance, kind, n))(kinds, count)
    links = jax.vmap(lambda kind: _longest_link(distance, kind, one, other, num))(kinds)
    axes = jax.vmap(lambda kind, n: _axes(way, kind, n))(kinds, count)
    return jnp.concatenate([each, axes, links[:, None]], axis=1), count


def _levels(distance, kind, count):
    """Quantiles (_LEVELS,) of the distances (P,) of one kind."""
    ordered = jnp.sort(jnp.where(kind, distance, jnp.inf))
    ordered = jnp.where(jnp.isfinite(ordered), ordered, 0.0)
    last = jnp.maximum(count - 1, 0)
    at = jnp.linspace(0.0, 1.0, _LEVELS) * last
    below = jnp.floor(at).astype(jnp.int32)
    above = jnp.minimum(below + 1, last)
    return ordered[below] + (at - below) * (ordered[above] - ordered[below])


def _axes(way, kind, count):
    """Root mean squares (2,) of the ways (P, 2) of one kind, along their narrow and wide axes."""
    chosen = jnp.where(kind[:, None], way, 0.0)
    moment = chosen.T @ chosen / jnp.maximum(count, 1)
    half = (moment[0, 0] + moment[1, 1]) / 2
    apart = safe_norm(jnp.stack([(moment[0, 0] - moment[1, 1]) / 2, moment[0, 1]]))
    squares = jax.nn.relu(jnp.stack([half - apart, half + apart]))
    return jnp.sqrt(squares + 1e-6) - 1e-3  # with a slope at 0


def _longest_link(distance, kind, one, other, num):
    """The widest gap on the best ways between partners of one kind."""
    everywhere = jnp.zeros((num, num), jnp.int32).at[one, other].set(jnp.arange(len(one)))
    gap = jnp.where(kind, jax.lax.stop_gradient(distance), jnp.inf)[everywhere + everywhere.T]
    gap = jnp.where(jnp.eye(num, dtype=bool), 0.0, gap)
    for _ in range(max(1, (num - 1).bit_length())):  # ways of twice as many steps
        gap = jnp.min(jnp.maximum(gap[:, :, None], gap[None]), axis=1)
    longest = jnp.max(jnp.where(kind, gap[one, other], -1.0), initial=-1.0)
    # It is the distance of one pair, and has the slope of that one alone.
    which = jnp.argmin(jnp.where(kind, jnp.abs(distance - longest), jnp.inf))
    return jnp.sum(jnp.where(kind & (jnp.arange(len(one)) == which), distance, 0.0))
