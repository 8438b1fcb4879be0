"""Active contact rows of one episode: their list, and the solver's passes over them.

The rows lie in the order of `physics.Physics`'s layers. As there, the solver treats the rows of a
layer at once: it computes the changes of all of them, then applies their kicks.
"""

import warp as wp

from . import bodies
from .bodies import Floats, Vec2s, Vec3s, cross, turned


@bodies.no_type_check
class Touch:
    """The deepest contact found so far; there is none while the gap is positive."""

    gap: float
    normal: wp.vec2  # from the first body to the second
    second: wp.vec2  # contact point relative to the second body's centre


@bodies.no_type_check
class Row:
    """A contact that the solver sees; see `impulses.Rows`."""

    first: int  # -1 is a wall
    second: int
    layer: int  # rows of a layer are computed at once
    slot: int  # of the normal impulse in the memory
    tangent_slot: int
    normal: wp.vec2
    leverage: wp.vec2  # of (normal, tangent) on the second body
    recoil: wp.vec2  # ... on the first
    mass: wp.vec2  # effective mass along (normal, tangent)
    bias: float
    friction: float
    sums: wp.vec3  # impulses: normal, tangent, shift
    change: wp.vec3  # of these in the present pass


@bodies.no_type_check
def nothing() -> Touch:
    """No contact yet."""
    return Touch(1.0e3, wp.vec2(0.0, 0.0), wp.vec2(0.0, 0.0))


@bodies.no_type_check
def deeper(best: Touch, gap: float, normal: wp.vec2, second: wp.vec2) -> Touch:
    """The deeper of two contacts."""
    if gap < best.gap:
        return Touch(gap, normal, second)
    return best


@bodies.no_type_check
def prepared(
    touch: Touch, first: int, second: int, friction: float, rate: float, pose: Vec3s, weights: Vec2s
) -> Row:
    """The row of a contact; `rate` is the share of an overlap that is undone in a second."""
    row, n = Row(), touch.normal
    t = turned(n)
    row.first = first
    row.second = second
    row.normal = n
    row.friction = friction
    row.leverage = wp.vec2(cross(touch.second, n), cross(touch.second, t))
    w = weights[second]
    inverse = wp.vec2(w[0], w[0]) + w[1] * wp.cw_mul(row.leverage, row.leverage)
    if first >= 0:
        offset = pose[second] - pose[first]
        arm = wp.vec2(offset[0], offset[1]) + touch.second - n * touch.gap
        row.recoil = wp.vec2(cross(arm, n), cross(arm, t))
        w = weights[first]
        inverse += wp.vec2(w[0], w[0]) + w[1] * wp.cw_mul(row.recoil, row.recoil)
    row.mass = wp.vec2(1.0 / inverse[0], 1.0 / inverse[1])
    row.bias = rate * wp.max(-touch.gap - 0.01, 0.0)
    return row


@bodies.no_type_check
def append(
    rows: wp.array(dtype=Row), count: int, row: Row, layer: int, slot: int, width: int,
    memory: Floats,
) -> int:  # fmt: skip
    """Lists a row with the impulses that the memory has for it; returns the new count."""
    row.layer = layer
    row.slot = slot
    row.tangent_slot = slot + width
    row.sums = wp.vec3(memory[slot], memory[slot + width], 0.0)
    rows[count] = row
    return count + 1


@bodies.no_type_check
def kick(row: Row, j: wp.vec3, velocity: Vec3s, shift: Vec3s, weights: Vec2s):
    """Gives both bodies the impulses j (normal, tangent, shift)."""
    n = row.normal
    push, apart = n * j[0] + turned(n) * j[1], n * j[2]
    w = weights[row.second]
    arm = row.leverage
    velocity[row.second] = velocity[row.second] + wp.vec3(
        push[0] * w[0], push[1] * w[0], w[1] * (arm[0] * j[0] + arm[1] * j[1])
    )
    shift[row.second] = shift[row.second] + wp.vec3(
        apart[0] * w[0], apart[1] * w[0], w[1] * (arm[0] * j[2])
    )
    if row.first >= 0:
        w = weights[row.first]
        arm = row.recoil
        velocity[row.first] = velocity[row.first] - wp.vec3(
            push[0] * w[0], push[1] * w[0], w[1] * (arm[0] * j[0] + arm[1] * j[1])
        )
        shift[row.first] = shift[row.first] - wp.vec3(
            apart[0] * w[0], apart[1] * w[0], w[1] * (arm[0] * j[2])
        )


@bodies.no_type_check
def _speeds(n: wp.vec2, arm: wp.vec2, velocity: wp.vec3, shift: wp.vec3) -> wp.vec3:
    """Speeds at a contact: along the normal, the tangent, and the normal of the second system."""
    v, s = wp.vec2(velocity[0], velocity[1]), wp.vec2(shift[0], shift[1])
    return wp.vec3(
        wp.dot(n, v) + velocity[2] * arm[0],
        cross(n, v) + velocity[2] * arm[1],
        wp.dot(n, s) + shift[2] * arm[0],
    )


@bodies.no_type_check
def _solved(row: Row, velocity: Vec3s, shift: Vec3s) -> wp.vec3:
    """The row's impulses after a pass."""
    a, b = row.first, row.second
    v = _speeds(row.normal, row.leverage, velocity[b], shift[b])
    if a >= 0:
        v -= _speeds(row.normal, row.recoil, velocity[a], shift[a])
    normal = wp.max(row.sums[0] - v[0] * row.mass[0], 0.0)
    most = row.friction * normal
    tangent = wp.clamp(row.sums[1] - v[1] * row.mass[1], -most, most)
    return wp.vec3(normal, tangent, wp.max(row.sums[2] + (row.bias - v[2]) * row.mass[0], 0.0))


@bodies.no_type_check
def sweep(rows: wp.array(dtype=Row), count: int, velocity: Vec3s, shift: Vec3s, weights: Vec2s):
    """One pass over all rows, a layer at a time."""
    done = wp.int32(0)
    for r in range(count):
        row = rows[r]
        sums = _solved(row, velocity, shift)
        rows[r].change = sums - row.sums
        rows[r].sums = sums
        last = r == count - 1
        if not last:
            last = rows[r + 1].layer != row.layer
        if last:
            for q in range(done, r + 1):
                kick(rows[q], rows[q].change, velocity, shift, weights)
            done = r + 1
