"""Contacts solved by sequential impulses, as in the original's engine, Chipmunk.

A sweep takes the layers of contacts in turn and gives each contact the impulse that would satisfy
it, clamped as a sum: contacts only push, friction stays within its cone. A second system of
pseudo-velocities undoes overlaps and is then forgotten, so that it sets nothing in motion.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .contacts import Contacts
from .plane import Vec

SLOP = 0.01  # overlap that is not pushed apart
LEFT = 0.9**60  # share of an overlap that is left after a second


class Bodies(NamedTuple):
    """The weights of N bodies; zeros for what cannot be moved."""

    inverse_mass: Float[Array, "*N"]
    inverse_inertia: Float[Array, "*N"]


class Motion(NamedTuple):
    """Velocities of N bodies, and the pseudo-velocities beside them."""

    push: Vec
    spin: Float[Array, "*N"]
    shift: Vec
    twist: Float[Array, "*N"]


class Impulse(NamedTuple):
    """Summed impulses of N contacts."""

    normal: Float[Array, "*N"]
    tangent: Float[Array, "*N"]
    shift: Float[Array, "*N"]  # along the normal, of the second system


class Rows(NamedTuple):
    """A layer of contacts prepared for the solver; a zero mass switches one off."""

    normal: Vec  # from the first body to the second
    leverage: Vec  # of (normal, tangent) on the second body
    recoil: Vec  # ... on the first
    mass: Vec  # effective mass along (normal, tangent)
    bias: Float[Array, "*N"]  # speed at which an overlap is undone
    friction: Float[Array, "*N"] | float
    first: Bodies | None  # None is a wall
    second: Bodies


def prepare(
    contacts: Contacts, friction, first: Bodies | None, offset: Vec | None, second: Bodies, *, dt
) -> Rows:
    """Leverages, effective masses and target speeds of a layer for a substep of `dt` seconds.

    The offset leads from the first bodies' centres to the second's; it is None with a wall.
    """
    n = contacts.normal
    t = n.turned()
    leverage = Vec(contacts.second.cross(n), contacts.second.cross(t))
    arms = (leverage.x, leverage.y)
    inverse = [second.inverse_mass + second.inverse_inertia * arm**2 for arm in arms]
    recoil = leverage
    if first is not None:
        arm = offset + contacts.second - n * contacts.gap
        recoil = Vec(arm.cross(n), arm.cross(t))
        both = zip(inverse, (recoil.x, recoil.y), strict=True)
        inverse = [i + first.inverse_mass + first.inverse_inertia * arm**2 for i, arm in both]
    # As in Chipmunk, bodies that will meet within the substep do not feel each other yet.
    touch = contacts.gap <= 0
    mass = Vec(*(jnp.where(touch, 1.0 / i, 0.0) for i in inverse))
    bias = (1.0 - LEFT**dt) / dt * jnp.maximum(-contacts.gap - SLOP, 0.0)
    return Rows(n, leverage, recoil, mass, bias, friction, first, second)


def kick(rows: Rows, j: Impulse) -> tuple[Motion | None, Motion]:
    """The changes that impulses make to the motions of the first and the second bodies."""
    push = rows.normal * j.normal + rows.normal.turned() * j.tangent
    shift = rows.normal * j.shift

    def change(body: Bodies, arm: Vec, sign: float) -> Motion:
        m, i = sign * body.inverse_mass, sign * body.inverse_inertia
        spin = i * (arm.x * j.normal + arm.y * j.tangent)
        return Motion(push * m, spin, shift * m, i * (arm.x * j.shift))

    back = None if rows.first is None else change(rows.first, rows.recoil, -1.0)
    return back, change(rows.second, rows.leverage, 1.0)


def solve(rows: Rows, j: Impulse, first: Motion | None, second: Motion) -> Impulse:
    """The layer's summed impulses after one pass."""
    n = rows.normal

    def along(body: Motion, arm: Vec):
        tangent = n.cross(body.push) + body.spin * arm.y
        return n.dot(body.push) + body.spin * arm.x, tangent, n.dot(body.shift) + body.twist * arm.x

    vn, vt, vs = along(second, rows.leverage)
    if first is not None:
        un, ut, us = along(first, rows.recoil)
        vn, vt, vs = vn - un, vt - ut, vs - us
    normal = jnp.maximum(j.normal - vn * rows.mass.x, 0.0)
    most = rows.friction * normal
    tangent = jnp.clip(j.tangent - vt * rows.mass.y, -most, most)
    shift = jnp.maximum(j.shift + (rows.bias - vs) * rows.mass.x, 0.0)
    return Impulse(normal, tangent, shift)
