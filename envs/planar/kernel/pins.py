"""The original MAGICAL's fingers and pupils in the kernel, as in `magical.physics`."""

import warp as wp

from . import device
from .device import Vec2s, Vec3s
from .outlines import cross, turned
from .servos import Aims, limited, pin, plane

ON_PLACE = wp.constant(1.0e-6)
STIFFNESS = wp.constant(0.1)
DAMPING = wp.constant(3.0e-3)
PUPIL = wp.constant(0.002)


@device.no_type_check
class Pupils:
    """The fields of `magical.physics.Pupils`."""

    lag: wp.vec2
    spin: wp.vec2
    wanted: wp.vec2


@device.no_type_check
def swung(pupils: Pupils, spin: float, dt: float) -> Pupils:
    """The pupils a substep later, behind a base of that spin."""
    lag = pupils.lag + dt * (wp.vec2(spin, spin) - pupils.spin)
    return Pupils(lag, pupils.spin + dt * STIFFNESS / PUPIL * lag, wp.vec2(0.0, 0.0))


@device.no_type_check
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


@device.no_type_check
def direction(off: wp.vec2, f: int, dt: float) -> wp.vec2:
    """Unit vector from where finger f should be to where it is; `magical.physics.HELD` if there."""
    far = wp.sqrt(wp.dot(off, off) + 1.0e-20)
    if far * dt > ON_PLACE:
        return off * (-1.0 / far)
    return wp.where(f == 0, wp.vec2(1.0, 0.0), wp.vec2(0.9486832980505138, 0.31622776601683794))


@device.no_type_check
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
