"""Ranks by a reward of states in scenes that its videos do not show.

An audit needs stages, which are those of the Demo start's things. Where colours, shapes, places or
counts are others, a task still has a score. So the things of a start are put elsewhere at random,
and states of the same start are compared: those that the score calls successes, and all others.
States are sampled, not searched for: this tells whether a reward holds elsewhere, and an audit
whether it can be hacked.

Shapes use N for objects, the robot first, then R regions and blocks, and K for states.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

_WHOLE = 1 / 3  # share of states in which all things go where the state's form puts them
# In units of the arena: how far a heap reaches, and where its middle is; the distance of neighbours
# on a line, and how far the line's middle is from the arena's.
_HEAP, _CORNER = 0.28, 0.55
_PITCH, _MIDDLE = 0.27, 0.3
_INSIDE = 0.45  # of a region's size: the furthest from its middle
_TOUCHING = 0.85  # of the sum of two blocks' half sides: nearer than that one is in the other


class Ranked(NamedTuple):
    """Figures of one start; NaN if its states are all successes, or none is."""

    auc: Float[Array, ""]
    """Share of pairs of a success and another state in which the success has more reward."""
    best: Float[Array, ""]
    """1 if the state with the highest reward is a success, else 0."""


class Start(NamedTuple):
    """The robot, regions and blocks of a start."""

    center: Float[Array, "N 2"]
    size: Float[Array, "N 2"]  # 0 of what is not there
    kind: Int[Array, "N 2"]  # two numbers of each, such as its colour and its shape
    regions: int  # R
    arena: float  # half its side, world units

    @property
    def blocks(self) -> Bool[Array, "N"]:
        """The blocks that are there."""
        at = jnp.arange(len(self.center))
        return (self.size > 0).all(axis=1) & (at > self.regions)

    @property
    def moves(self) -> Bool[Array, "N"]:
        """Those, and the robot."""
        return self.blocks | (jnp.arange(len(self.center)) == 0)


def arrangements(key: PRNGKeyArray, start: Start, count: int) -> Float[Array, "K N 2"]:
    """Centres of K = `count` states, in which robot and blocks lie elsewhere.

    A state has a form: blocks anywhere, in regions, on a line, or in four heaps by the first or the
    second number of their `kind` or by chance. In most states some stay where they are; regions and
    what is not there always do. The key is consumed.
    """
    forms = [_anywhere, _in_line, _by_first, _by_second, _by_chance]
    forms += [_in_regions] * (start.regions > 0)
    limit = jnp.maximum(start.arena - start.size / 2, 0.0)

    def one(key):
        keys = jax.random.split(key, 4)
        form = jax.random.randint(keys[1], (), 0, len(forms))
        placed = jnp.stack([put(keys[0], start) for put in forms])[form]
        share = jax.random.uniform(keys[2], maxval=1.0 / (1.0 - _WHOLE))
        goes = start.moves & (jax.random.uniform(keys[3], start.moves.shape) < share)
        return jnp.where(goes[:, None], jnp.clip(placed, -limit, limit), start.center)

    return jax.vmap(one)(jax.random.split(key, count))


def possible(center: Float[Array, "N 2"], start: Start) -> Bool[Array, ""]:
    """True if no block of a state lies in another one."""
    reach = start.size.min(axis=1) / 2
    apart = jnp.sum((center[:, None] - center) ** 2, axis=-1)
    inside = apart < (_TOUCHING * (reach[:, None] + reach)) ** 2
    others = start.blocks[:, None] & start.blocks & ~jnp.eye(len(center), dtype=bool)
    return ~(inside & others).any()


def ranked(
    reward: Float[Array, "K"], success: Bool[Array, "K"], counted: Bool[Array, "K"]
) -> Ranked:
    """The figures of a start's states, as far as they are counted; a tie counts half."""
    good, bad = success & counted, ~success & counted
    pairs = good[:, None] & bad
    above = (reward[:, None] > reward) + 0.5 * (reward[:, None] == reward)
    auc = jnp.sum(jnp.where(pairs, above, 0.0)) / jnp.sum(pairs)
    best = good[jnp.argmax(jnp.where(counted, reward, -jnp.inf))]
    return Ranked(auc, jnp.where(pairs.any(), best, jnp.nan))


# --- forms of states: where everything would lie, (N, 2), world units


def _anywhere(key, start: Start):
    return start.arena * jax.random.uniform(key, start.center.shape, minval=-1.0)


def _in_regions(key, start: Start):
    keys, count = jax.random.split(key), len(start.center)
    at = jax.random.randint(keys[0], (count,), 1, 1 + start.regions)
    aside = jax.random.uniform(keys[1], (count, 2), minval=-_INSIDE, maxval=_INSIDE)
    return start.center[at] + start.size[at] * aside


def _in_line(key, start: Start):
    """Side by side in random order."""
    keys = jax.random.split(key, 3)
    order = jnp.where(start.blocks, jax.random.uniform(keys[0], start.blocks.shape), 2.0)
    place = jnp.argsort(jnp.argsort(order)) - (jnp.sum(start.blocks) - 1) / 2
    turn = jax.random.uniform(keys[1], maxval=jnp.pi)
    middle = jax.random.uniform(keys[2], (2,), minval=-_MIDDLE, maxval=_MIDDLE)
    way = jnp.stack([jnp.cos(turn), jnp.sin(turn)])
    return start.arena * (middle + _PITCH * place[:, None] * way)


def _by_first(key, start: Start):
    return _heaped(key, start.kind[:, 0], start.arena)


def _by_second(key, start: Start):
    return _heaped(key, start.kind[:, 1], start.arena)


def _by_chance(key, start: Start):
    key_heap, key_place = jax.random.split(key)
    heap = jax.random.randint(key_heap, start.blocks.shape, 0, 4)
    return _heaped(key_place, heap, start.arena)


def _heaped(key: PRNGKeyArray, heap: Int[Array, "N"], arena: float) -> Float[Array, "N 2"]:
    """Things of equal numbers, modulo 4, in a corner of the arena."""
    keys = jax.random.split(key)
    corners = jnp.array([[-_CORNER, -_CORNER], [-_CORNER, _CORNER], [_CORNER, -_CORNER]])
    corners = jax.random.permutation(keys[0], jnp.concatenate([corners, -corners[:1]]))
    aside = jax.random.uniform(keys[1], (len(heap), 2), minval=-_HEAP, maxval=_HEAP)
    return arena * (corners[heap % 4] + aside)
