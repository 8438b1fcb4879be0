"""The joints of a planar scene: the table under the blocks, the drive, the fingers.

Each joint gets, in turn, the impulse that would satisfy it, its sum clamped by its strength times
the step, as in Chipmunk. A motion here is a velocity and a spin.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .contacts import Frames
from .impulses import Bodies
from .plane import Vec
from .robots import FINGER_OPEN, PIVOTS

TURN_RATE, FINGER_RATE = 2.5, 1.0  # rad/s, the fastest that the servos aim at
_SIDES = np.array([1.0, -1.0], np.float32)  # sign of an open finger's angle, left first
_PIVOTS = Vec(*PIVOTS.T.astype(np.float32))


class Strengths(NamedTuple):
    """The largest forces and torques; the Dynamics variant samples them."""

    drive: Float[Array, ""]
    turn: Float[Array, ""]
    finger: Float[Array, ""]
    table: Float[Array, ""]  # force with which the table holds a block
    table_turn: Float[Array, ""]


class Command(NamedTuple):
    """A command to the robot for one control step."""

    speed: Float[Array, ""]  # forward, units/s
    turn: Float[Array, ""]  # heading offset that the servo aims at, rad
    opening: Float[Array, ""]  # finger angle, rad; 0 is closed


class Servo(NamedTuple):
    """An impulse and a torque impulse: of the table on each block, of the drive on the base."""

    push: Vec
    turn: Float[Array, "*N"]


class FingerImpulses(NamedTuple):
    """Impulses of the fingers' pivots, stops and motors."""

    pivot: Vec  # (2,)
    limit: Float[Array, "2"]
    motor: Float[Array, "2"]


class Aims(NamedTuple):
    """The joints' aims in one substep; the fingers' fields are None without fingers."""

    drive: Vec  # velocity of the base
    turn: Float[Array, ""]  # its spin
    rate: Float[Array, "2"] | None = None  # of the fingers, relative to the base
    arm: Vec | None = None  # from the base's centre to the pivots
    pivot: Vec | None = None  # velocity that brings a finger back onto its pivot
    limit: Float[Array, "2"] | None = None  # rate that brings it back into its range; 0 inside


def aims(
    before: Float[Array, "P 3"],
    parts: Float[Array, "P 3"],
    place: Frames,
    spin: Float[Array, ""],
    command: Command,
    *,
    dt: float,
) -> Aims:
    """Targets of a substep for a robot's parts; the servos were set by their poses `before` it."""
    yaw = before[0, 2]
    # The servo aimed at an offset from the heading, of which the turn since then is done.
    turn = jnp.clip(command.turn / dt - spin, -TURN_RATE, TURN_RATE)
    drive = Vec(-command.speed * jnp.sin(yaw), command.speed * jnp.cos(yaw))
    if len(parts) == 1:
        return Aims(drive, turn)
    error = command.opening * _SIDES - (before[1:, 2] - yaw)
    rate = jnp.where(jnp.abs(error) < 1e-4, 0.0, jnp.clip(10 * error, -FINGER_RATE, FINGER_RATE))
    arm = _PIVOTS.out_of(place.heading[0])
    pivot = (place.center[0] + arm - place.center[1:]) * (1.0 / dt)
    angle = _SIDES * (parts[1:, 2] - parts[0, 2])  # 0 closed, positive towards open
    beyond = jnp.maximum(angle - FINGER_OPEN, 0.0) + jnp.minimum(angle, 0.0)
    return Aims(drive, turn, rate, arm, pivot, -_SIDES * beyond / dt)


def _clamp(push: Vec, turn, force, torque) -> Servo:
    """Clips the force vector, and the torque, to their largest sizes."""
    share = jnp.minimum(1.0, force / jnp.sqrt(push.dot(push) + 1e-20))
    return Servo(push * share, jnp.clip(turn, -torque, torque))


def hold(velocity: Vec, spin: Array, given: Servo, blocks: Bodies, force, torque) -> Servo:
    """The table's summed impulses on the blocks, which resist any motion."""
    push = given.push - velocity * (1.0 / blocks.inverse_mass)
    return _clamp(push, given.turn - spin / blocks.inverse_inertia, force, torque)


def drive(velocity: Vec, spin, given: Servo, aim: Aims, base: Bodies, force, torque) -> Servo:
    """The summed impulses of the speed and turn servos."""
    push = given.push + (aim.drive - velocity) * (1.0 / base.inverse_mass)
    return _clamp(push, given.turn + (aim.turn - spin) / base.inverse_inertia, force, torque)


def pin(velocity: Vec, spin: Array, j: Vec, aim: Aims, bodies: Bodies) -> tuple[Vec, Array]:
    """Velocities and spins after the pivots' impulses: the base's, with the reaction, and the
    fingers'."""
    mass, inertia = bodies
    torque = aim.arm.cross(j)
    x = jnp.concatenate([-mass[:1] * (j.x[:1] + j.x[1:]), mass[1:] * j.x])
    y = jnp.concatenate([-mass[:1] * (j.y[:1] + j.y[1:]), mass[1:] * j.y])
    back = -inertia[:1] * (torque[:1] + torque[1:])
    spin = spin + jnp.concatenate([back, jnp.zeros_like(torque)])
    return Vec(velocity.x + x, velocity.y + y), spin


def turn_fingers(spin: Float[Array, "3"], j: Float[Array, "2"], bodies: Bodies):
    """Spins after torque impulses between the base and the fingers."""
    inertia = bodies.inverse_inertia
    return spin + inertia * jnp.concatenate([-(j[:1] + j[1:]), j])


def fingers(
    velocity: Vec, spin: Array, given: FingerImpulses, aim: Aims, bodies: Bodies, strength
) -> tuple[Vec, Array, FingerImpulses]:
    """Solves pivots, stops and motors of both fingers at once; bodies are base and fingers."""
    mass, inertia = bodies
    light, arm = mass[0] + mass[1:], aim.arm
    a = light + inertia[0] * arm.y * arm.y
    b = -inertia[0] * arm.x * arm.y
    d = light + inertia[0] * arm.x * arm.x
    missing = aim.pivot - (velocity[1:] - (velocity[0] + arm.turned() * spin[0]))
    pivot = Vec(d * missing.x - b * missing.y, a * missing.y - b * missing.x)
    pivot = pivot * (1.0 / (a * d - b * b))
    velocity, spin = pin(velocity, spin, pivot, aim, bodies)

    light = 1.0 / (inertia[0] + inertia[1:])
    wanted = given.limit + (aim.limit - (spin[1:] - spin[0])) * light
    limit = jnp.where(aim.limit > 0, jnp.maximum(wanted, 0.0), jnp.minimum(wanted, 0.0))
    limit = jnp.where(aim.limit == 0, 0.0, limit)
    spin = turn_fingers(spin, limit - given.limit, bodies)
    motor = given.motor + (aim.rate - (spin[1:] - spin[0])) * light
    motor = jnp.clip(motor, -strength, strength)
    spin = turn_fingers(spin, motor - given.motor, bodies)
    return velocity, spin, FingerImpulses(given.pivot + pivot, limit, motor)
