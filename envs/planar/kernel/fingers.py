"""The fingers in the kernel: MAGICAL's pins and pupils, as in `magical.physics`, and what the
memory has of either kind of fingers, and the solver does with it."""

import warp as wp

from . import bodies
from .bodies import Floats, Vec2s, Vec3s, cross, turned
from .servos import Aims, grip, limited, pin, plane

ON_PLACE = wp.constant(1.0e-6)
STIFFNESS = wp.constant(0.1)
DAMPING = wp.constant(3.0e-3)
PUPIL = wp.constant(0.002)


@bodies.no_type_check
class Pupils:
    """The fields of `magical.physics.Pupils`."""

    lag: wp.vec2
    spin: wp.vec2
    wanted: wp.vec2


@bodies.no_type_check
def swung(pupils: Pupils, spin: float, dt: float) -> Pupils:
    """The pupils a substep later, behind a base of that spin."""
    lag = pupils.lag + dt * (wp.vec2(spin, spin) - pupils.spin)
    return Pupils(lag, pupils.spin + dt * STIFFNESS / PUPIL * lag, wp.vec2(0.0, 0.0))


@bodies.no_type_check
def damped(velocity: Vec3s, pupils: Pupils, weights: Vec2s, dt: float) -> Pupils:
    """One pass over the dampers of the pupils' springs."""
    inertia = weights[0][1]
    light = inertia + 1.0 / PUPIL
    share = 1.0 - wp.exp(-DAMPING * dt * light)
    base = velocity[0]
    for eye in range(2):
        apart = base[2] - pupils.spin[eye]
        change = (pupils.wanted[eye] - apart) * share
        base = base + wp.vec3(0.0, 0.0, change / light * inertia)
        pupils.spin[eye] = pupils.spin[eye] - change / light / PUPIL
        pupils.wanted[eye] = apart + change
    velocity[0] = base
    return pupils


@bodies.no_type_check
def direction(off: wp.vec2, f: int, dt: float) -> wp.vec2:
    """Unit vector from where finger f should be to where it is; `magical.physics.HELD` if there."""
    far = wp.sqrt(wp.dot(off, off) + 1.0e-20)
    if far * dt > ON_PLACE:
        return off * (-1.0 / far)
    return wp.where(f == 0, wp.vec2(1.0, 0.0), wp.vec2(0.9486832980505138, 0.31622776601683794))


@bodies.no_type_check
def pinned(
    velocity: Vec3s, f: int, given: wp.vec3, aim: Aims, weights: Vec2s, strength: float, dt: float
) -> wp.vec3:
    """Solves pin, stop and motor of one finger; returns their summed impulses."""
    arm, n, none = aim.arm[f], direction(aim.pivot[f], f, dt), wp.vec2(0.0, 0.0)
    base, finger, inertia = velocity[0], velocity[1 + f], weights[0][1]
    between = plane(finger) - plane(base) - turned(arm) * base[2]
    leverage = cross(arm, n)
    light = weights[0][0] + weights[1 + f][0] + inertia * leverage * leverage
    held = wp.dot(aim.pivot[f] - between, n) / light
    pin(velocity, f, arm, n * held, 0.0, weights)
    heavy, stop = 1.0 / (inertia + weights[1 + f][1]), aim.limit[f]
    limit = limited(given[1] + (stop - (velocity[1 + f][2] - velocity[0][2])) * heavy, stop)
    pin(velocity, f, none, none, limit - given[1], weights)
    motor = given[2] + (aim.rate[f] - (velocity[1 + f][2] - velocity[0][2])) * heavy
    motor = wp.clamp(motor, -strength, strength)
    pin(velocity, f, none, none, motor - given[2], weights)
    return wp.vec3(given[0] + held, limit, motor)


NONE, PIVOTS, PINS = (wp.constant(kind) for kind in range(3))  # the kinds of fingers


@bodies.no_type_check
class Fingers:
    """The fields of `joints.FingerImpulses` or of `magical.physics.Gripping`."""

    pivot: wp.mat22  # a row a finger
    pin: wp.vec2
    limit: wp.vec2
    motor: wp.vec2
    pupils: Pupils


@bodies.no_type_check
def _pair(memory: Floats, at: int) -> wp.vec2:
    return wp.vec2(memory[at], memory[at + 1])


@bodies.no_type_check
def _keep(memory: Floats, at: int, pair: wp.vec2):
    memory[at] = pair[0]
    memory[at + 1] = pair[1]


@bodies.no_type_check
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


@bodies.no_type_check
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


@bodies.no_type_check
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


@bodies.no_type_check
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
