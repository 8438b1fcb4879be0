"""The end of a training without a fixed length: evaluations that no longer improve.

    watched = begin(state, policy, evaluations=40)
    watched = noted(watched, success, value, policy)      # after each evaluation
    is_over(watched)                                      # for all seeds
    watched.best                                          # the policies that are kept

An evaluation counts by the mean of itself and the two before it, which a lucky one moves little.
All of it is part of the training's state, so a resumed run comes to the same end. Shapes use S for
seeds and E for evaluations.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

TOGETHER = 3  # evaluations in a mean
PATIENCE = 0.2  # of the steps so far, that may pass without improvement
_SOLVED = 0.99  # success at which there is nothing left to learn
_SAME = 0.02  # of what was gained in all: a smaller gain is none


class Watched(NamedTuple):
    """A training's state, its evaluations so far, and the best policies by them."""

    state: Any
    best: Any  # leaves (S, ...)
    success: Float[Array, "E S"]  # NaN where an evaluation is still to come
    value: Float[Array, "E S"]  # the return of what the policy is trained on, likewise


def begin(state: Any, policy: Any, *, evaluations: int, seeds: int) -> Watched:
    """A training before its first update."""
    none = jnp.full((evaluations, seeds), jnp.nan, jnp.float32)
    return Watched(state, _copied(policy), none, none)


def noted(watched: Watched, success: Any, value: Any, policy: Any) -> Watched:
    """With one evaluation more, (S,) each, of the policies (S, ...) as they are now."""
    at = count(watched)
    each = [np.array(x) for x in (watched.success, watched.value)]
    each[0][at], each[1][at] = success, value
    found = Watched(watched.state, watched.best, *map(jnp.asarray, each))
    better = best_so_far(found) == at
    return found._replace(best=_kept(better, policy, watched.best))


def count(watched: Watched) -> int:
    """Evaluations so far."""
    return int((~np.isnan(np.asarray(watched.success)[:, 0])).sum())


def best_so_far(watched: Watched) -> np.ndarray:
    """The evaluation, from 0, of the policy of each seed that is kept, (S,)."""
    done = count(watched)
    return best(np.asarray(watched.success)[:done], np.asarray(watched.value)[:done])


def is_over(watched: Watched, *, early: bool = False) -> bool:
    """True if all seeds have succeeded, or have not improved for a fifth of their steps; `early`
    only if all have succeeded."""
    done = count(watched)
    if done < TOGETHER:
        return False
    success, value = (np.asarray(x)[:done] for x in (watched.success, watched.value))
    solved = means(success).max(axis=0) >= _SOLVED
    late = np.maximum(improved(success), improved(value)) + 1 > (1 - PATIENCE) * done
    return bool((solved if early else solved | ~late).all())


def means(scores: Float[np.ndarray, "E S"]) -> Float[np.ndarray, "E S"]:
    """The mean of each evaluation and the two before it; those without two before them, -inf."""
    found = np.full(scores.shape, -np.inf)
    for end in range(TOGETHER, len(scores) + 1):
        found[end - 1] = scores[end - TOGETHER : end].astype(np.float64).mean(axis=0)
    return found


def improved(scores: Float[np.ndarray, "E S"]) -> np.ndarray:
    """The evaluation, from 0, at which each seed came to what it has not surpassed since, (S,)."""
    each = means(scores)[TOGETHER - 1 :]
    most = each.max(axis=0)
    return np.argmax(each >= most - _SAME * (most - each[0]), axis=0) + TOGETHER - 1


def best(success: Float[np.ndarray, "E S"], value: Float[np.ndarray, "E S"]) -> np.ndarray:
    """The evaluation, from 0, with the most success of each seed, (S,); of equals the one with the
    highest return. Until there are three it is the last one."""
    if len(success) < TOGETHER:
        return np.full(success.shape[1], len(success) - 1)
    each, returns = means(success), means(value)
    level = each >= each.max(axis=0) - 1e-9
    return np.argmax(np.where(level, returns, -np.inf), axis=0)


@jax.jit
def _copied(policy: Any) -> Any:
    return jax.tree.map(jnp.copy, policy)


@jax.jit
def _kept(better: Bool[Array, "S"], new: Any, old: Any) -> Any:
    def choose(one: Array, other: Array) -> Array:
        return jnp.where(better.reshape(-1, *[1] * (one.ndim - 1)), one, other)

    return jax.tree.map(choose, new, old)
