"""One control step of a robot and blocks on a table, seen from above; pure arrays in and out.

Every body, fingers included, has a pose (x, y, angle) and a velocity; joints are impulses like
contacts. The order of work in a substep is Chipmunk's: positions advance, contacts are found,
velocities are solved. With fewer than its ten substeps, positions take a share of the new velocity.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import contacts as touching
from . import joints as jointing
from .contacts import Frames
from .impulses import Bodies, Impulse, Motion, Rows, kick, prepare, solve
from .joints import Command, Strengths
from .plane import Vec, fence
from .robots import Robot
from .shapes import BlockShape

BLOCK_MASS = 0.01  # of the blocks whose inertia `BlockShape` gives
_SETTLING = 100  # sweeps that find the impulses of a scene that has none yet
BLOCK_FRICTION, WALL_FRICTION = 0.5, 0.8  # of one surface; Chipmunk multiplies the two that touch


class _Impulses(NamedTuple):
    """The impulses of contacts and joints in a substep."""

    contacts: list[Impulse]  # a layer each
    table: jointing.Servo
    drive: jointing.Servo
    fingers: jointing.FingerImpulses | None


class _Layer(NamedTuple):
    """A layer of contacts and the bodies that it joins."""

    rows: Rows
    kind: str  # "part", "blocks", "part walls" or "block walls"
    which: int  # the part, or by how much the second blocks are shifted


class Physics:
    """A robot among `num_blocks` blocks.

    A control step has `substeps`, each of them `iterations` sweeps over contacts and joints.
    """

    def __init__(
        self,
        robot: Robot,
        num_blocks: int,
        *,
        arena: float,
        control_hz: float = 8.0,
        substeps: int = 10,
        iterations: int = 10,
        block_mass: float = BLOCK_MASS,
    ):
        self.robot, self.num_blocks, self.arena = robot, num_blocks, arena
        self.substeps, self.iterations = substeps, iterations
        self.dt = 1.0 / (control_hz * substeps)
        self.block_mass = block_mass
        self.ahead = 0.5 - 0.05 * substeps if substeps < 10 else 0.0
        parts = robot.parts
        most = max(len(p.corners) for p in parts)
        index = [np.minimum(np.arange(most), len(p.corners) - 1) for p in parts]
        corners = np.stack([p.corners[i] for p, i in zip(parts, index, strict=True)])
        self._corners = Vec(*np.moveaxis(corners, 2, 0).transpose(0, 2, 1).astype(np.float32))
        self._radius = np.array([p.radius for p in parts], np.float32)
        self._rough = np.array([p.friction for p in parts], np.float32)
        self._parts = Bodies(
            np.array([1 / p.mass for p in parts], np.float32),
            np.array([1 / p.inertia for p in parts], np.float32),
        )
        self._base = Bodies(*(f[0] for f in self._parts))

    def rest(self) -> Float[Array, "I"]:
        """The memory of a scene in which nothing has touched yet."""
        # Not by packing one: outside of a program each array would be compiled by itself.
        return jnp.zeros(jax.eval_shape(lambda: self._pack(self._none())).size)

    # By itself, so that programs which share this object trace it once.
    @functools.partial(jax.jit, static_argnums=0)
    def step(
        self,
        pose: Float[Array, "E 3"],
        velocity: Float[Array, "E 3"],
        memory: Float[Array, "I"],
        shapes: BlockShape,
        strengths: Strengths,
        command: Command,
    ) -> tuple[Float[Array, "E 3"], Float[Array, "E 3"], Float[Array, "I"]]:
        """Poses, velocities and memory a control step later.

        Poses are x, y (arena units) and angle (rad) of the robot's parts, then of the blocks,
        velocities their rates per second; the memory is the impulses with which the solver begins.
        """

        def substep(carry, _):
            pose, velocity, shift, impulses = carry
            return self._substep(pose, velocity, shift, impulses, shapes, strengths, command), None

        carry = (pose, velocity, jnp.zeros_like(velocity), self._unpack(memory))
        carry, _ = jax.lax.scan(substep, carry, length=self.substeps)
        return carry[0], carry[1], self._pack(carry[3])

    def clearance(self, pose: Float[Array, "E 3"], shapes: BlockShape) -> Float[Array, ""]:
        """Gap between the robot and the nearest block or wall; negative where they overlap."""
        parts, blocks = self._places(pose)
        found = touching.walls(self._corners, self._radius, parts, arena=self.arena)
        for p, part in enumerate(self.robot.parts):
            found += touching.with_part(part, _only(parts, p), shapes, blocks)
        return jnp.stack([layer.gap.min() for layer in found]).min()

    def settle(
        self, pose, velocity, shapes: BlockShape, strengths: Strengths, command: Command
    ) -> Float[Array, "I"]:
        """The memory of a scene that `command` has just brought to these poses and velocities."""
        before, motion = pose - self.dt * velocity, self._motions(velocity)
        layers, aim = self._problem(before, pose, velocity[0, 2], shapes, command)
        sweep = lambda _, s: self._sweep(layers, aim, *s, shapes, strengths)  # noqa: E731
        return self._pack(jax.lax.fori_loop(0, _SETTLING, sweep, (motion, self._none()))[1])

    def _substep(self, before, velocity, shift, impulses, shapes, strengths, command):
        pose = before + self.dt * ((1 - self.ahead) * velocity + shift)
        layers, aim = self._problem(before, pose, velocity[0, 2], shapes, command)
        contacts = [
            Impulse(*(jnp.where(layer.rows.mass.x > 0, f, 0.0) for f in j[:2]), 0.0 * j.shift)
            for layer, j in zip(layers, impulses.contacts, strict=True)
        ]
        impulses = impulses._replace(contacts=contacts)
        motion = self._warm(layers, aim, self._motions(velocity), impulses, shapes)
        sweep = lambda _, s: self._sweep(layers, aim, *s, shapes, strengths)  # noqa: E731
        motion, impulses = jax.lax.fori_loop(0, self.iterations, sweep, (motion, impulses))
        velocity = _stacked(*((m.push, m.spin) for m in motion))
        shift = _stacked(*((m.shift, m.twist) for m in motion))
        return pose + self.dt * self.ahead * velocity, velocity, shift, impulses

    def _motions(self, velocity: Float[Array, "E 3"]) -> tuple[Motion, Motion]:
        """Motions of the robot's parts and of the blocks."""
        count = len(self.robot.parts)

        def motion(v):
            zero = jnp.zeros_like(v[:, 2])
            return Motion(Vec(v[:, 0], v[:, 1]), v[:, 2], Vec(zero, zero), zero)

        return motion(velocity[:count]), motion(velocity[count:])

    def _places(self, pose: Float[Array, "E 3"]) -> tuple[Frames, Frames]:
        """Places of the robot's parts and of the blocks."""
        place, count = fence(touching.frames(pose)), len(self.robot.parts)
        return _only(place, np.s_[:count]), _only(place, np.s_[count:])

    def _blocks(self, shapes: BlockShape) -> Bodies:
        inertia = shapes.inverse_inertia * (BLOCK_MASS / self.block_mass)
        return Bodies(jnp.full_like(inertia, 1 / self.block_mass), inertia)

    def _problem(self, before, pose, spin, shapes: BlockShape, command: Command):
        """Contacts and joint targets of a substep."""
        count, light, layers = len(self.robot.parts), self._blocks(shapes), []
        parts, blocks = self._places(pose)
        aim = jointing.aims(before[:count], pose[:count], parts, spin, command, dt=self.dt)

        def add(kind, which, contacts, *pair):
            made = (prepare(found, *pair, dt=self.dt) for found in contacts)
            layers.extend(_Layer(rows, kind, which) for rows in made)

        for p, part in enumerate(self.robot.parts):
            at, rough = _only(parts, p), part.friction * BLOCK_FRICTION
            contacts, heavy = touching.with_part(part, at, shapes, blocks), _only(self._parts, p)
            add("part", p, contacts, rough, heavy, blocks.center - at.center, light)
        for k, found in enumerate(touching.between_blocks(shapes, blocks), start=1):
            second, center = jax.tree.map(lambda f, k=k: jnp.roll(f, -k), (light, blocks.center))
            add("blocks", k, [found], BLOCK_FRICTION**2, light, center - blocks.center, second)
        walls = touching.walls(self._corners, self._radius, parts, arena=self.arena)
        add("part walls", 0, walls, WALL_FRICTION * self._rough, None, None, self._parts)
        walls = touching.walls(shapes.corners, shapes.radius, blocks, arena=self.arena)
        add("block walls", 0, walls, WALL_FRICTION * BLOCK_FRICTION, None, None, light)
        return layers, aim

    def _warm(self, layers, aim, motion, impulses: _Impulses, shapes) -> tuple[Motion, Motion]:
        """Motions after the last substep's impulses (warm start)."""
        parts, blocks = motion
        for layer, j in zip(layers, impulses.contacts, strict=True):
            parts, blocks = _kicked(layer, j, parts, blocks)
        blocks = _served(blocks, impulses.table, self._blocks(shapes))
        parts = _with_base(parts, _served(_only(parts, 0), impulses.drive, self._base))
        j = impulses.fingers
        if j is not None:
            push, spin = jointing.pin(parts.push, parts.spin, j.pivot, aim, self._parts)
            spin = jointing.turn_fingers(spin, j.limit + j.motor, self._parts)
            parts = parts._replace(push=push, spin=spin)
        return parts, blocks

    def _sweep(self, layers, aim, motion, impulses: _Impulses, shapes, strengths: Strengths):
        """One pass over all contacts, then all joints."""
        (parts, blocks), contacts = motion, []
        for layer, j in zip(layers, impulses.contacts, strict=True):
            new = fence(solve(layer.rows, j, *_sides(layer, parts, blocks)))
            step = Impulse(*(a - b for a, b in zip(new, j, strict=True)))
            parts, blocks = fence(_kicked(layer, step, parts, blocks))
            contacts.append(new)

        light, s = self._blocks(shapes), Strengths(*(force * self.dt for force in strengths))
        given = impulses.table
        table = jointing.hold(blocks.push, blocks.spin, given, light, s.table, s.table_turn)
        blocks = _served(blocks, jax.tree.map(jnp.subtract, table, given), light)
        base, given = _only(parts, 0), impulses.drive
        drive = jointing.drive(base.push, base.spin, given, aim, self._base, s.drive, s.turn)
        change = jax.tree.map(jnp.subtract, drive, given)
        parts = _with_base(parts, _served(base, change, self._base))
        fingers, moving = impulses.fingers, (parts.push, parts.spin)
        if fingers is not None:
            push, spin, fingers = jointing.fingers(*moving, fingers, aim, self._parts, s.finger)
            parts = parts._replace(push=push, spin=spin)
        return (parts, blocks), _Impulses(contacts, table, drive, fingers)

    def _none(self) -> _Impulses:
        parts, blocks = len(self.robot.parts), self.num_blocks
        layers = sum(map(touching.layers_of, self.robot.parts)) + max(blocks - 1, 0)
        sizes = [blocks] * layers + [parts] * 4 + [blocks] * 4
        zero, some, pair = jnp.zeros(()), jnp.zeros(blocks), jnp.zeros(2)
        fingers = jointing.FingerImpulses(Vec(pair, pair), pair, pair)
        return _Impulses(
            [Impulse(*[jnp.zeros(n)] * 3) for n in sizes],
            jointing.Servo(Vec(some, some), some),
            jointing.Servo(Vec(zero, zero), zero),
            fingers if self.robot.has_fingers else None,
        )

    def _pack(self, impulses: _Impulses) -> Float[Array, "I"]:
        kept = impulses._replace(contacts=[j[:2] for j in impulses.contacts])
        return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(kept)])

    def _unpack(self, memory: Float[Array, "I"]) -> _Impulses:
        none = self._none()
        kept = none._replace(contacts=[j[:2] for j in none.contacts])
        leaves, tree = jax.tree.flatten(kept)
        pieces = jnp.split(memory, np.cumsum([leaf.size for leaf in leaves])[:-1])
        leaves = [p.reshape(leaf.shape) for p, leaf in zip(pieces, leaves, strict=True)]
        kept = jax.tree.unflatten(tree, leaves)
        return kept._replace(contacts=[Impulse(*j, 0.0 * j[0]) for j in kept.contacts])


def _only(bodies, which):
    """The motions, places or weights of some of several bodies."""
    return type(bodies)(*(f[which] for f in bodies))


def _with_base(parts: Motion, base: Motion) -> Motion:
    return jax.tree.map(lambda all_, one: jnp.concatenate([one[None], all_[1:]]), parts, base)


def _served(motion: Motion, j: jointing.Servo, bodies: Bodies) -> Motion:
    """Motions after the impulses of the table or the drive."""
    push = motion.push + j.push * bodies.inverse_mass
    return motion._replace(push=push, spin=motion.spin + j.turn * bodies.inverse_inertia)


def _sides(layer: _Layer, parts: Motion, blocks: Motion) -> tuple[Motion | None, Motion]:
    """Motions of the layer's first and second bodies."""
    if layer.kind == "part":
        return _only(parts, layer.which), blocks
    if layer.kind == "blocks":
        return blocks, jax.tree.map(lambda f: jnp.roll(f, -layer.which), blocks)
    return None, parts if layer.kind == "part walls" else blocks


def _kicked(layer: _Layer, j: Impulse, parts: Motion, blocks: Motion) -> tuple[Motion, Motion]:
    """Motions after a layer's impulses."""
    first, second = kick(layer.rows, j)
    plus = functools.partial(jax.tree.map, jnp.add)
    if layer.kind == "part":
        at = (np.arange(len(parts.spin)) == layer.which).astype(np.float32)
        push = jax.tree.map(lambda all_, one: all_ + at * one.sum(), parts, first)
        return push, plus(blocks, second)
    if layer.kind == "blocks":
        second = jax.tree.map(lambda f: jnp.roll(f, layer.which), second)
        return parts, plus(plus(blocks, first), second)
    if layer.kind == "part walls":
        return plus(parts, second), blocks
    return parts, plus(blocks, second)


def _stacked(*motions: tuple[Vec, Array]) -> Float[Array, "E 3"]:
    """Velocities of parts and blocks as one array."""
    rows = zip(*((v.x, v.y, w) for v, w in motions), strict=True)
    return jnp.stack([jnp.concatenate(f) for f in rows], axis=-1)
