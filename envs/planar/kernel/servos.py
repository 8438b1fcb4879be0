"""The joints of a planar scene in the kernel, as in `planar.joints`: table, drive, fingers.

A velocity is (x, y, spin), an impulse of the table or the drive (x, y, torque).
"""

import warp as wp

from . import bodies
from .bodies import Vec2s, Vec3s, cross, out_of, turned

TURN_RATE = wp.constant(2.5)
FINGER_RATE = wp.constant(1.0)
FINGER_OPEN = wp.constant(0.39269908169872414)  # rad
PIVOT_X = wp.constant(0.09)
PIVOT_Y = wp.constant(0.02)


@bodies.no_type_check
class Command:
    """The fields of `joints.Command`, and the step in seconds."""

    speed: float
    turn: float
    opening: float
    dt: float


@bodies.no_type_check
class Aims:
    """The fields of `joints.Aims`; of matrices a row is a finger's."""

    drive: wp.vec3  # velocity of the base, with its spin
    rate: wp.vec2
    arm: wp.mat22
    pivot: wp.mat22
    limit: wp.vec2


@bodies.no_type_check
def _finger_side(f: int) -> float:
    """Sign of an open finger's angle, left first."""
    return wp.where(f == 0, 1.0, -1.0)


@bodies.no_type_check
def plane(v: wp.vec3) -> wp.vec2:
    """The velocity without the spin."""
    return wp.vec2(v[0], v[1])


@bodies.no_type_check
def aims_of(
    before: Vec3s, pose: Vec3s, heading: wp.vec2, spin: float, command: Command, fingers: bool
) -> Aims:
    """Targets of a substep; the servos were set by the poses `before` it."""
    aim, yaw = Aims(), before[0][2]
    turn = wp.clamp(command.turn / command.dt - spin, -TURN_RATE, TURN_RATE)
    aim.drive = wp.vec3(-command.speed * wp.sin(yaw), command.speed * wp.cos(yaw), turn)
    if not fingers:
        return aim
    for f in range(2):
        side = _finger_side(f)
        error = command.opening * side - (before[1 + f][2] - yaw)
        if wp.abs(error) >= 1.0e-4:
            aim.rate[f] = wp.clamp(10.0 * error, -FINGER_RATE, FINGER_RATE)
        arm = out_of(wp.vec2(-side * PIVOT_X, PIVOT_Y), heading)
        off = plane(pose[0]) + arm - plane(pose[1 + f])
        aim.arm[f] = arm
        aim.pivot[f] = off * (1.0 / command.dt)
        angle = side * (pose[1 + f][2] - pose[0][2])
        beyond = wp.max(angle - FINGER_OPEN, 0.0) + wp.min(angle, 0.0)
        aim.limit[f] = -side * beyond / command.dt
    return aim


@bodies.no_type_check
def served(v: wp.vec3, j: wp.vec3, weight: wp.vec2) -> wp.vec3:
    """A velocity after an impulse and a torque."""
    return v + wp.vec3(j[0] * weight[0], j[1] * weight[0], j[2] * weight[1])


@bodies.no_type_check
def steered(
    v: wp.vec3, given: wp.vec3, aim: wp.vec3, weight: wp.vec2, force: float, torque: float
) -> wp.vec3:
    """The summed impulse towards a velocity, its vector and its torque clipped to their sizes."""
    push = plane(given) + (plane(aim) - plane(v)) * (1.0 / weight[0])
    push = push * wp.min(1.0, force / wp.sqrt(wp.dot(push, push) + 1.0e-20))
    turn = wp.clamp(given[2] + (aim[2] - v[2]) / weight[1], -torque, torque)
    return wp.vec3(push[0], push[1], turn)


@bodies.no_type_check
def pin(velocity: Vec3s, f: int, arm: wp.vec2, j: wp.vec2, torque: float, weights: Vec2s):
    """Kicks finger f at its pivot and turns it, and gives the base the reaction."""
    back = wp.vec3(-j[0], -j[1], -cross(arm, j) - torque)
    velocity[0] = served(velocity[0], back, weights[0])
    velocity[1 + f] = served(velocity[1 + f], wp.vec3(j[0], j[1], torque), weights[1 + f])


@bodies.no_type_check
def limited(sum: float, aim: float) -> float:
    """A stop's summed impulse: none within the range, and never outwards."""
    if aim == 0.0:
        return 0.0
    return wp.where(aim > 0.0, wp.max(sum, 0.0), wp.min(sum, 0.0))


@bodies.no_type_check
def _pivot_impulse(velocity: Vec3s, f: int, aim: Aims, weights: Vec2s) -> wp.vec2:
    """The impulse that brings finger f back onto its pivot."""
    base, arm, inertia = velocity[0], aim.arm[f], weights[0][1]
    light = weights[0][0] + weights[1 + f][0]
    a = light + inertia * arm[1] * arm[1]
    b = -inertia * arm[0] * arm[1]
    d = light + inertia * arm[0] * arm[0]
    missing = aim.pivot[f] - (plane(velocity[1 + f]) - (plane(base) + turned(arm) * base[2]))
    pivot = wp.vec2(d * missing[0] - b * missing[1], a * missing[1] - b * missing[0])
    return pivot * (1.0 / (a * d - b * b))


@bodies.no_type_check
def grip(
    velocity: Vec3s, pivots: wp.mat22, limits: wp.vec2, motors: wp.vec2, aim: Aims, weights: Vec2s,
    strength: float,
):  # fmt: skip
    """Solves pivots, stops and motors of both fingers at once; returns their summed impulses."""
    none = wp.vec2(0.0, 0.0)
    first = _pivot_impulse(velocity, 0, aim, weights)
    second = _pivot_impulse(velocity, 1, aim, weights)
    pin(velocity, 0, aim.arm[0], first, 0.0, weights)
    pin(velocity, 1, aim.arm[1], second, 0.0, weights)
    spin = velocity[0][2]
    new = wp.vec2()
    for f in range(2):
        light = 1.0 / (weights[0][1] + weights[1 + f][1])
        sum = limits[f] + (aim.limit[f] - (velocity[1 + f][2] - spin)) * light
        new[f] = limited(sum, aim.limit[f])
    for f in range(2):
        pin(velocity, f, none, none, new[f] - limits[f], weights)
    spin = velocity[0][2]
    motor = wp.vec2()
    for f in range(2):
        light = 1.0 / (weights[0][1] + weights[1 + f][1])
        sum = motors[f] + (aim.rate[f] - (velocity[1 + f][2] - spin)) * light
        motor[f] = wp.clamp(sum, -strength, strength)
    for f in range(2):
        pin(velocity, f, none, none, motor[f] - motors[f], weights)
    return pivots + wp.matrix_from_rows(first, second), new, motor
