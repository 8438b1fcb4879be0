"""What belongs in larger things that rest, and what is kept out of them, at the ends of videos.

    bonds = found(container, center, size, label, member)         # of last frames, once
    cost = lacking(bonds, center, size, label, counted, due, near_cost_fraction)   # of any scene

    inside, outside   a class is in, or out of, a thing of another class in nearly all ends
    filled            where several things of a class hold others, each holds one

A thing is in another one where its centre is. Shapes use B for videos, N for objects and C for
classes; lengths are world units.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .edges import crossed

_MOST, _FEW = 0.85, 0.15  # shares of ends that make a rule
_ABSENT = -1e3  # distance out of a thing that the scene lacks, world units
_REACH = 0.5  # world units over which the rest of the cost grows, at least


class Bonds(NamedTuple):
    """Which class belongs where."""

    container: Bool[Array, "C"]  # it rests, and holds others
    inside: Bool[Array, "C C"]  # class by container
    outside: Bool[Array, "C C"]
    filled: Bool[Array, "C"]


def nothing(classes: int) -> Bonds:
    """Bonds of none."""
    none, pairs = jnp.zeros(classes, bool), jnp.zeros((classes, classes), bool)
    return Bonds(none, pairs, pairs, none)


def found(
    container: Bool[Array, "C"],
    center: Float[Array, "B N 2"],
    size: Float[Array, "B N 2"],
    label: Int[Array, "B N"],
    member: Bool[Array, "B N C"],
) -> Bonds:
    """The bonds that nearly all ends have in common; `member` is which object has which class."""
    one = member.astype(center.dtype)
    out = jax.vmap(lambda *x: _outwardness(container, *x))(center, size, label)
    known = jnp.isfinite(out).astype(center.dtype)  # (B, N, C)
    total = jnp.einsum("bnc,bnr->cr", one, known)
    share = jnp.einsum("bnc,bnr->cr", one, known * (out <= 0)) / jnp.maximum(total, 1.0)
    possible = (total > 0) & ~container[:, None]
    inside = possible & (share > _MOST)
    empty = jax.vmap(lambda *x: _emptiness(inside, *x))(center, size, label, member.any(axis=-1))
    holds = jnp.einsum("bnc,bn->c", one, (empty <= 0).astype(center.dtype))
    several = (member.sum(axis=1) > 1).any(axis=0)
    filled = container & several & (holds > _MOST * jnp.maximum(member.sum(axis=(0, 1)), 1))
    return Bonds(container, inside, possible & (share < _FEW), filled)


def lacking(
    bonds: Bonds,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
    counted: Bool[Array, "N"],
    due: Float[Array, "N"],
    near_cost_fraction: Float[Array, ""] | float,
) -> Float[Array, ""]:
    """Cost of what is not where it belongs, and of what is empty; `due` is each object's weight.

    The fraction `near_cost_fraction` applies across the edge (`edges.crossed`), the rest grows in
    proportion to the distance.
    """
    out = _outwardness(bonds.container, center, size, label)  # (N, C)
    known = jnp.isfinite(out)
    out = jnp.where(known, out, 0.0)
    side = (size.min(axis=1) / 2 + 1e-6)[:, None]

    def cost(beyond, half):
        far = jax.nn.relu(beyond) / _REACH
        return near_cost_fraction * crossed(beyond, half) + (1.0 - near_cost_fraction) * far

    total = jnp.zeros(())
    for rule, sign in ((bonds.inside, 1.0), (bonds.outside, -1.0)):
        each = cost(sign * out, side)  # of the centre, from where it belongs
        each = jnp.where(rule[label] & known & counted[:, None], each, 0.0).sum(axis=1)
        total += jnp.sum(due * each)
    empty = _emptiness(bonds.inside, center, size, label, counted)
    lacks = counted & bonds.filled[label] & jnp.isfinite(empty)
    smallest = jnp.min(jnp.where(counted, side[:, 0], jnp.inf), initial=1.0)
    return total + jnp.sum(cost(jnp.where(lacks, empty, _ABSENT), smallest))


def _beyond(center, size):
    """Distance of each centre out of each box, (N, N); negative inside."""
    return (jnp.abs(center[:, None] - center) - size / 2).max(axis=-1)


def _outwardness(container, center, size, label):
    """Distance of each centre out of the nearest container of each class, (N, C); negative inside,
    infinite where the scene has none."""
    of_class = (label[:, None] == jnp.arange(len(container))) & container  # (N, C)
    return jnp.where(of_class.T[None], _beyond(center, size)[:, None], jnp.inf).min(axis=-1)


def _emptiness(inside, center, size, label, there):
    """How far the nearest thing that belongs in each object is out of it, (N,); infinite where
    nothing does."""
    belongs = inside[label[:, None], label] & there[:, None] & there
    return jnp.where(belongs, _beyond(center, size), jnp.inf).min(axis=0)
