"""The kernel of one control step: a thread loads an episode, plays its substeps and stores it.

A kernel is made for a robot, a number of blocks and a kind of fingers, which set the sizes of its
local arrays; the rest are arguments. Warp keeps compiled kernels on disk.
"""

import functools
from typing import no_type_check

import warp as wp
from gril_jax.envs.planar import robots
from gril_jax.envs.planar.contacts import layers_of

from . import bodies
from .bodies import Floats, Part, Shapes, Vec2s, Vec3s, numbers, part_of
from .fingers import NONE, PINS, Fingers, recalled, remember, solve, swung, warm
from .rows import Row, Touch, kick, sweep
from .servos import Aims, Command, aims_of, served, steered
from .touches import Scene, find_rows

OUTPUTS = 3  # of the kernel: poses, velocities, memories
Strengths = wp.types.vector(5, wp.float32)  # the fields of `joints.Strengths`


@bodies.no_type_check
def _table_and_drive(
    scene: Scene, velocity: Vec3s, weights: Vec2s, table: Vec3s, drive: wp.vec3, aim: Aims,
    most: Strengths,
) -> wp.vec3:  # fmt: skip
    """One pass over these joints; returns the drive's summed impulse. `most` are impulses."""
    for b in range(scene.blocks):
        e = scene.parts + b
        if wp.length_sq(velocity[e]) + wp.length_sq(table[b]) > 0.0:  # else it stays still
            held = steered(velocity[e], table[b], wp.vec3(), weights[e], most[3], most[4])
            velocity[e] = served(velocity[e], held - table[b], weights[e])
            table[b] = held
    new = steered(velocity[0], drive, aim.drive, weights[0], most[0], most[1])
    velocity[0] = served(velocity[0], new - drive, weights[0])
    return new


@bodies.no_type_check
def _solve(
    scene: Scene, rows: wp.array(dtype=Row), count: int, iterations: int, kind: int,
    velocity: Vec3s, shift: Vec3s, weights: Vec2s, table: Vec3s, drive: wp.vec3, fingers: Fingers,
    aim: Aims, most: Strengths, dt: float,
):  # fmt: skip
    """Warm start, then all passes of a substep; returns the impulses of drive and fingers."""
    for r in range(count):
        kick(rows[r], rows[r].sums, velocity, shift, weights)
    for b in range(scene.blocks):
        e = scene.parts + b
        velocity[e] = served(velocity[e], table[b], weights[e])
    velocity[0] = served(velocity[0], drive, weights[0])
    warm(velocity, fingers, kind, aim, weights, dt)
    servo, hands = drive, fingers
    for _ in range(iterations):
        sweep(rows, count, velocity, shift, weights)
        servo = _table_and_drive(scene, velocity, weights, table, servo, aim, most)
        hands = solve(velocity, hands, kind, aim, weights, most[2], dt)
    return servo, hands


@bodies.no_type_check
def _keep_rows(
    rows: wp.array(dtype=Row), count: int, old: wp.array(dtype=wp.vec2i), memory: Floats
):
    """Writes the rows' impulses into the memory, and into `old` where they are."""
    for r in range(count):
        memory[rows[r].slot] = rows[r].sums[0]
        memory[rows[r].tangent_slot] = rows[r].sums[1]
        old[r] = wp.vec2i(rows[r].slot, rows[r].tangent_slot)


@bodies.no_type_check
def _forget(memory: Floats, contacts: int, old: wp.array(dtype=wp.vec2i), known: int):
    """Zeros the memory of contacts: that of the `known` ones in `old`, or if -1 of all."""
    if known < 0:
        for slot in range(contacts):
            memory[slot] = 0.0
    for r in range(known):
        memory[old[r][0]] = 0.0
        memory[old[r][1]] = 0.0


@bodies.no_type_check
def _move(
    pose: Vec3s, before: Vec3s, velocity: Vec3s, shift: Vec3s, heading: Vec2s, bodies: int,
    dt: float, share: float,
):  # fmt: skip
    """Advances the poses with that share of the velocities, and forgets the shifts."""
    for e in range(bodies):
        before[e] = pose[e]
        pose[e] = pose[e] + dt * (share * velocity[e] + shift[e])
        if pose[e][2] != before[e][2]:  # most blocks are still
            heading[e] = wp.vec2(wp.cos(pose[e][2]), wp.sin(pose[e][2]))
        shift[e] = wp.vec3()


@functools.cache
def control_step(robot: str, blocks: int, kind: int) -> wp.Kernel:
    """The kernel for a robot (of `robots.ROBOTS`), a number of blocks and a kind of `fingers`."""
    described = robots.robot(robot).parts
    parts, bodies, table_of_parts = len(described), len(described) + blocks, numbers(described)
    layers = sum(map(layers_of, described)) + blocks - 1
    most = blocks * layers + 4 * bodies
    contacts = 2 * most

    @wp.kernel(enable_backward=False, module="unique")
    @no_type_check
    def step(
        pose: wp.array2d(dtype=wp.vec3), velocity: wp.array2d(dtype=wp.vec3),
        memory: wp.array2d(dtype=float), directions: wp.array3d(dtype=wp.vec2),
        corners: wp.array3d(dtype=wp.vec2), rims: wp.array3d(dtype=wp.vec2),
        sizes: wp.array3d(dtype=float), strengths: wp.array(dtype=Strengths), commands: Vec3s,
        inverse_mass: float, arena: float, dt: float, ahead: float, rate: float, substeps: int,
        iterations: int, new_pose: wp.array2d(dtype=wp.vec3),
        new_velocity: wp.array2d(dtype=wp.vec3), new_memory: wp.array2d(dtype=float),
    ):  # fmt: skip
        lane = wp.tid()
        at, before = wp.zeros(shape=bodies, dtype=wp.vec3), wp.zeros(shape=bodies, dtype=wp.vec3)
        moving, shift = wp.zeros(shape=bodies, dtype=wp.vec3), wp.zeros(shape=bodies, dtype=wp.vec3)
        heading = wp.zeros(shape=bodies, dtype=wp.vec2)
        weights = wp.zeros(shape=bodies, dtype=wp.vec2)
        rows, old = wp.zeros(shape=most, dtype=Row), wp.zeros(shape=most, dtype=wp.vec2i)
        others, table = wp.zeros(shape=blocks, dtype=Touch), wp.zeros(shape=blocks, dtype=wp.vec3)
        body = wp.zeros(shape=parts, dtype=Part)

        shapes = Shapes(directions[lane], corners[lane], rims[lane], sizes[lane])
        scene, given = Scene(parts, blocks, arena, rate), commands[lane]
        command, force = Command(given[0], given[1], given[2], dt), strengths[lane] * dt
        kept = new_memory[lane]
        for i in range(memory.shape[1]):
            kept[i] = memory[lane, i]
        for p in range(parts):
            body[p] = part_of(table_of_parts[p])
            weights[p] = body[p].weight
        for e in range(bodies):
            at[e] = pose[lane, e]
            moving[e] = velocity[lane, e]
            heading[e] = wp.vec2(wp.cos(at[e][2]), wp.sin(at[e][2]))
        end = contacts + 3 * blocks
        for b in range(blocks):
            weights[parts + b] = wp.vec2(inverse_mass, shapes.sizes[b, 1])
            i = contacts + b
            table[b] = wp.vec3(kept[i], kept[i + blocks], kept[i + 2 * blocks])
        drive = wp.vec3(kept[end], kept[end + 1], kept[end + 2])
        fingers = recalled(kept, end + 3, kind)

        known = wp.int32(-1)
        for _ in range(substeps):
            if kind == PINS:
                fingers.pupils = swung(fingers.pupils, moving[0][2] + shift[0][2], dt)
            _move(at, before, moving, shift, heading, bodies, dt, 1.0 - ahead)
            count = find_rows(body, shapes, scene, at, heading, weights, kept, others, rows)
            _forget(kept, contacts, old, known)
            aim = aims_of(before, at, heading[0], moving[0][2], command, kind != NONE)
            drive, fingers = _solve(
                scene, rows, count, iterations, kind, moving, shift, weights, table, drive,
                fingers, aim, force, dt,
            )  # fmt: skip
            _keep_rows(rows, count, old, kept)
            known = count
            for e in range(bodies):
                at[e] = at[e] + dt * ahead * moving[e]

        for e in range(bodies):
            new_pose[lane, e] = at[e]
            new_velocity[lane, e] = moving[e]
        for b in range(blocks):
            kept[contacts + b] = table[b][0]
            kept[contacts + blocks + b] = table[b][1]
            kept[contacts + 2 * blocks + b] = table[b][2]
        kept[end] = drive[0]
        kept[end + 1] = drive[1]
        kept[end + 2] = drive[2]
        remember(kept, end + 3, kind, fingers)

    return step
