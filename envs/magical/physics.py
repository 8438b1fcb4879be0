"""The original MAGICAL's physics, where it differs from x-magical's, on top of `Physics`.

Fingers hang on pin joints of length zero, not on pivots: a pin holds its finger along one direction
only, that in which it is off its place, so that it may slip sideways in a substep. Pupils of the
robot's eyes turn on soft springs and calm the servo of the heading.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from gril_jax.envs.planar.impulses import Bodies, Motion
from gril_jax.envs.planar.joints import Aims
from gril_jax.envs.planar.physics import Physics
from gril_jax.envs.planar.plane import Vec, where
from jaxtyping import Array, Float

_ON_PLACE = 1e-6  # arena units: a finger nearer than this is where it should be
HELD = np.array([[1.0, 0.0], [3.0, 1.0]]) / np.sqrt([[1.0], [10.0]])  # where it is then held:
# of all directions those that the original's rounding chooses in the Demo start of MatchRegions
_STIFFNESS, _DAMPING, _PUPIL = 0.1, 3e-3, 0.002  # of a pupil's spring; the pupil's inertia


class Pupils(NamedTuple):
    """State of the two pupils."""

    lag: Float[Array, "2"]  # angle by which the base is ahead, rad
    spin: Float[Array, "2"]  # rad/s
    wanted: Float[Array, "2"]  # difference of spins that the damper aims at


class Gripping(NamedTuple):
    """Summed impulses of the fingers, left first, and the rest of the robot's memory."""

    pin: Float[Array, "2"]
    limit: Float[Array, "2"]
    motor: Float[Array, "2"]
    pupils: Pupils


def _directions(aim: Aims, dt: float) -> Vec:
    """Unit vectors from where each finger should be to where it is; `HELD` if it is there."""
    off = jnp.sqrt(aim.pivot.dot(aim.pivot) + 1e-20)  # over dt
    held = Vec(*HELD.T.astype(np.float32))
    return where(off * dt > _ON_PLACE, aim.pivot * (-1.0 / off), held)


def _kick(parts: Motion, which: int, n: Vec, leverage, j, torque, bodies: Bodies) -> Motion:
    """Motions after an impulse along `n` and a torque impulse between base and finger."""
    mass, inertia = bodies
    add = lambda v, n: v.at[0].add(-mass[0] * n * j).at[which].add(mass[which] * n * j)  # noqa: E731
    push = Vec(add(parts.push.x, n.x), add(parts.push.y, n.y))
    spin = parts.spin.at[0].add(-inertia[0] * (leverage * j + torque))
    return parts._replace(push=push, spin=spin.at[which].add(inertia[which] * torque))


def _finger(parts: Motion, f: int, n: Vec, given: Gripping, aim: Aims, bodies: Bodies, strength):
    """Solves pin, stop and motor of one finger: the parts' motions, and the three impulses."""
    mass, inertia = bodies
    which, arm = 1 + f, aim.arm[f]
    leverage = arm.cross(n)
    between = parts.push[which] - parts.push[0] - arm.turned() * parts.spin[0]
    light = mass[0] + mass[which] + inertia[0] * leverage**2
    pin = (aim.pivot[f] - between).dot(n) / light
    parts = _kick(parts, which, n, leverage, pin, 0.0, bodies)

    heavy = 1.0 / (inertia[0] + inertia[which])
    stop = aim.limit[f]
    wanted = given.limit[f] + (stop - (parts.spin[which] - parts.spin[0])) * heavy
    limit = jnp.where(stop > 0, jnp.maximum(wanted, 0.0), jnp.minimum(wanted, 0.0))
    limit = jnp.where(stop == 0, 0.0, limit)
    parts = _kick(parts, which, n, 0.0, 0.0, limit - given.limit[f], bodies)
    motor = given.motor[f] + (aim.rate[f] - (parts.spin[which] - parts.spin[0])) * heavy
    motor = jnp.clip(motor, -strength, strength)
    parts = _kick(parts, which, n, 0.0, 0.0, motor - given.motor[f], bodies)
    return parts, (given.pin[f] + pin, limit, motor)


def _damped(parts: Motion, pupils: Pupils, bodies: Bodies, dt: float) -> tuple[Motion, Pupils]:
    """One pass over the dampers of the pupils' springs."""
    inertia = bodies.inverse_inertia[0]
    light = inertia + 1 / _PUPIL
    share = 1.0 - jnp.exp(-_DAMPING * dt * light)
    spin, made = parts.spin, []
    for eye in (0, 1):
        apart = spin[0] - pupils.spin[eye]
        change = (pupils.wanted[eye] - apart) * share
        spin = spin.at[0].add(change / light * inertia)
        made.append((pupils.spin[eye] - change / light / _PUPIL, apart + change))
    turned, wanted = (jnp.stack(f) for f in zip(*made, strict=True))
    return parts._replace(spin=spin), pupils._replace(spin=turned, wanted=wanted)


class MagicalPhysics(Physics):
    """`Physics` with pinned fingers and pupils."""

    def _substep(self, before, velocity, shift, impulses, *rest):
        held = impulses.fingers
        if held is not None:
            lag = held.pupils.lag + self.dt * (velocity[0, 2] + shift[0, 2] - held.pupils.spin)
            spin = held.pupils.spin + self.dt * _STIFFNESS / _PUPIL * lag
            held = held._replace(pupils=Pupils(lag, spin, jnp.zeros(2)))
        return super()._substep(before, velocity, shift, impulses._replace(fingers=held), *rest)

    def _warm(self, layers, aim, motion, impulses, shapes):
        held, bodies = impulses.fingers, self._parts
        parts, blocks = super()._warm(layers, aim, motion, impulses._replace(fingers=None), shapes)
        if held is None:
            return parts, blocks
        spring = self.dt * _STIFFNESS * held.pupils.lag.sum()
        parts = parts._replace(spin=parts.spin.at[0].add(-bodies.inverse_inertia[0] * spring))
        n = _directions(aim, self.dt)
        for f in (0, 1):
            torque = jnp.where(aim.limit[f] == 0, 0.0, held.limit[f]) + held.motor[f]
            leverage = aim.arm[f].cross(n[f])
            parts = _kick(parts, 1 + f, n[f], leverage, held.pin[f], torque, bodies)
        return parts, blocks

    def _sweep(self, layers, aim, motion, impulses, shapes, strengths):
        held, rest = impulses.fingers, impulses._replace(fingers=None)
        (parts, blocks), made = super()._sweep(layers, aim, motion, rest, shapes, strengths)
        if held is None:
            return (parts, blocks), made
        bodies, strength = self._parts, strengths.finger * self.dt
        parts, pupils = _damped(parts, held.pupils, bodies, self.dt)
        held = held._replace(limit=jnp.where(aim.limit == 0, 0.0, held.limit))
        n = _directions(aim, self.dt)
        parts, left = _finger(parts, 0, n[0], held, aim, bodies, strength)
        parts, right = _finger(parts, 1, n[1], held, aim, bodies, strength)
        sums = (jnp.stack(f) for f in zip(left, right, strict=True))
        return (parts, blocks), made._replace(fingers=Gripping(*sums, pupils))

    def _none(self):
        none = super()._none()
        if none.fingers is None:
            return none
        pair = jnp.zeros(2)
        return none._replace(fingers=Gripping(pair, pair, pair, Pupils(pair, pair, pair)))
