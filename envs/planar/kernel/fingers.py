"""The fingers' summed impulses in the kernel: where the memory has them, and the solver's use."""

import warp as wp

from . import device
from .device import Floats, Vec2s, Vec3s
from .pins import STIFFNESS, Pupils, damped, direction, pinned
from .servos import Aims, grip, pin

NONE, PIVOTS, PINS = (wp.constant(kind) for kind in range(3))  # the kinds of fingers


@device.no_type_check
class Fingers:
    """The fields of `joints.FingerImpulses` or of `magical.physics.Gripping`."""

    pivot: wp.mat22  # a row a finger
    pin: wp.vec2
    limit: wp.vec2
    motor: wp.vec2
    pupils: Pupils


@device.no_type_check
def _pair(memory: Floats, at: int) -> wp.vec2:
    return wp.vec2(memory[at], memory[at + 1])


@device.no_type_check
def _keep(memory: Floats, at: int, pair: wp.vec2):
    memory[at] = pair[0]
    memory[at + 1] = pair[1]


@device.no_type_check
def recalled(memory: Floats, at: int, kind: int) -> Fingers:
    """The impulses in the memory from `at` on."""
    fingers = Fingers()
    if kind == PIVOTS:
        x, y = _pair(memory, at), _pair(memory, at + 2)
        fingers.pivot = wp.transpose(wp.matrix_from_rows(x, y))
        fingers.limit = _pair(memory, at + 4)
        fingers.motor = _pair(memory, at + 6)
    elif kind == PINS:
        fingers.pin = _pair(memory, at)
        fingers.limit = _pair(memory, at + 2)
        fingers.motor = _pair(memory, at + 4)
        spin, wanted = _pair(memory, at + 8), _pair(memory, at + 10)
        fingers.pupils = Pupils(_pair(memory, at + 6), spin, wanted)
    return fingers


@device.no_type_check
def remember(memory: Floats, at: int, kind: int, fingers: Fingers):
    """Puts the impulses into the memory."""
    if kind == PIVOTS:
        columns = wp.transpose(fingers.pivot)
        _keep(memory, at, columns[0])
        _keep(memory, at + 2, columns[1])
        _keep(memory, at + 4, fingers.limit)
        _keep(memory, at + 6, fingers.motor)
    elif kind == PINS:
        _keep(memory, at, fingers.pin)
        _keep(memory, at + 2, fingers.limit)
        _keep(memory, at + 4, fingers.motor)
        _keep(memory, at + 6, fingers.pupils.lag)
        _keep(memory, at + 8, fingers.pupils.spin)
        _keep(memory, at + 10, fingers.pupils.wanted)


@device.no_type_check
def warm(velocity: Vec3s, fingers: Fingers, kind: int, aim: Aims, weights: Vec2s, dt: float):
    """Kicks base and fingers by the impulses of the last substep."""
    if kind == PIVOTS:
        for f in range(2):
            torque = fingers.limit[f] + fingers.motor[f]
            pin(velocity, f, aim.arm[f], fingers.pivot[f], torque, weights)
    elif kind == PINS:
        lag = fingers.pupils.lag
        spring = dt * STIFFNESS * (lag[0] + lag[1])
        velocity[0] = velocity[0] - wp.vec3(0.0, 0.0, weights[0][1] * spring)
        for f in range(2):
            torque = wp.where(aim.limit[f] == 0.0, 0.0, fingers.limit[f]) + fingers.motor[f]
            push = direction(aim.pivot[f], f, dt) * fingers.pin[f]
            pin(velocity, f, aim.arm[f], push, torque, weights)


@device.no_type_check
def solve(
    velocity: Vec3s, fingers: Fingers, kind: int, aim: Aims, weights: Vec2s, strength: float,
    dt: float,
) -> Fingers:  # fmt: skip
    """One pass over the joints of the fingers; returns their summed impulses."""
    if kind == PIVOTS:
        pivot, limit, motor = grip(
            velocity, fingers.pivot, fingers.limit, fingers.motor, aim, weights, strength
        )
        fingers.pivot = pivot
        fingers.limit = limit
        fingers.motor = motor
    elif kind == PINS:
        fingers.pupils = damped(velocity, fingers.pupils, weights, dt)
        for f in range(2):
            stop = wp.where(aim.limit[f] == 0.0, 0.0, fingers.limit[f])
            given = wp.vec3(fingers.pin[f], stop, fingers.motor[f])
            sums = pinned(velocity, f, given, aim, weights, strength, dt)
            fingers.pin[f] = sums[0]
            fingers.limit[f] = sums[1]
            fingers.motor[f] = sums[2]
    return fingers
