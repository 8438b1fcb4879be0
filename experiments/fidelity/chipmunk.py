"""The original's own engine, Chipmunk through pymunk 5.6, behind the interface of our engines.

Its scenes are built from our tables of robots and shapes. Each episode has a scene of its own on
the host, whose number is the episode's memory: the scene keeps the engine's impulses, and an
episode must be played on from where it was left.
"""

import collections
import importlib
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.planar import robots, shapes
from gril_jax.envs.planar.joints import TURN_RATE, Command, Strengths
from gril_jax.envs.planar.physics import BLOCK_FRICTION, WALL_FRICTION
from gril_jax.envs.planar.polygons import box_polygon
from jaxtyping import Array, Float

_SWEEPS, _SLOP = 10, 0.01  # the original's
_PUPIL = (0.1, 0.002)  # mass and inertia
_OPEN = robots.FINGER_OPEN


def _pymunk() -> Any:
    """The package; ValueError says which is missing."""
    collections.Sequence = collections.abc.Sequence  # type: ignore[attr-defined]  # for pymunk 5
    try:
        return importlib.import_module("pymunk")
    except ImportError as error:
        raise ValueError(
            f"the original's engine needs a package: pip install pymunk==5.6.0 ({error})"
        ) from error


class _Scene:
    """A robot and blocks in a Chipmunk space, at rest at `pose` (E, 3)."""

    def __init__(self, of: "Chipmunk", pose: np.ndarray, strengths: Strengths):
        pm, self.space, self.of = of.pymunk, of.pymunk.Space(), of
        self.space.collision_slop, self.space.iterations = _SLOP, _SWEEPS
        self.group, parts = 1, of.robot.parts
        self._walls(of.arena)
        blocks = pose[len(parts) :]
        self.blocks = [self._block(*b, strengths) for b in zip(of.kinds, blocks, strict=True)]
        self.parts = [self._body(p.mass, p.inertia, at) for p, at in zip(parts, pose, strict=False)]
        self.control = pm.Body(body_type=pm.Body.KINEMATIC)
        self.control.position, self.control.angle = self.parts[0].position, self.parts[0].angle
        if of.pins:
            self._drive(strengths)
        self._eyes()
        self.motors = [self._finger(k, strengths.finger) for k in range(1, len(parts))]
        if not of.pins:
            self._drive(strengths)
        for body, part in zip(self.parts, parts, strict=True):
            self._outlines(body, part)

    def _body(self, mass, inertia, pose):
        body = self.of.pymunk.Body(float(mass), float(inertia))
        body.position, body.angle = (float(pose[0]), float(pose[1])), float(pose[2])
        self.space.add(body)
        return body

    def _joint(self, joint, strength, *, bias):
        joint.max_bias, joint.max_force = bias, float(strength)
        self.space.add(joint)
        return joint

    def _add(self, shape, friction, group):
        shape.friction = friction
        if group:
            shape.filter = self.of.pymunk.ShapeFilter(group=group)
        self.space.add(shape)

    def _walls(self, arena):
        pm, far = self.of.pymunk, arena + 1.0
        corners = [(-far, far), (far, far), (far, -far), (-far, -far)]
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            self._add(pm.Segment(self.space.static_body, a, b, 1.0), WALL_FRICTION, 0)

    def _block(self, kind, pose, strengths):
        pm, one = self.of.pymunk, shapes.blocks(jnp.array(shapes.SHAPES.index(kind)))
        inertia = self.of.block_mass / 0.01 / float(one.inverse_inertia)
        body, radius = self._body(self.of.block_mass, inertia, pose), float(one.radius)
        self.group += 1
        if kind == "circle":
            self._add(pm.Circle(body, radius), BLOCK_FRICTION, 0)
        elif kind == "star":
            rim = shapes.outline(kind)
            for k in range(0, 10, 2):
                arm = [(0.0, 0.0), *(tuple(map(float, rim[(k + i) % 10])) for i in (-1, 0, 1))]
                self._add(pm.Poly(body, arm), BLOCK_FRICTION, self.group)
        else:
            corners = [tuple(map(float, v)) for v in shapes.outline(kind)]
            self._add(pm.Poly(body, corners, radius=radius), BLOCK_FRICTION, 0)
        ground = self.space.static_body
        self._joint(pm.PivotJoint(ground, body, (0, 0), (0, 0)), strengths.table, bias=0)
        self._joint(pm.GearJoint(ground, body, 0.0, 1.0), strengths.table_turn, bias=0)
        return body

    def _finger(self, k, strength):
        pm, base, finger = self.of.pymunk, self.parts[0], self.parts[k]
        anchor = tuple(map(float, robots.PIVOTS[k - 1]))
        hinge = pm.PinJoint if self.of.pins else pm.PivotJoint
        low, high = (0.0, _OPEN) if k == 1 else (-_OPEN, 0.0)
        held = hinge(base, finger, anchor, (0, 0))
        for joint in (held, pm.RotaryLimitJoint(base, finger, low, high)):
            joint.error_bias = 0.0
            self.space.add(joint)
        return self._joint(pm.SimpleMotor(base, finger, 0.0), strength, bias=0)

    def _drive(self, strengths):
        pm, base = self.of.pymunk, self.parts[0]
        self._joint(pm.PivotJoint(self.control, base, (0, 0), (0, 0)), strengths.drive, bias=0)
        turn = pm.GearJoint(self.control, base, 0.0, 1.0)
        turn.error_bias = 0.0
        self._joint(turn, strengths.turn, bias=TURN_RATE)

    def _eyes(self):
        pm, base = self.of.pymunk, self.parts[0]
        for _ in range(2):
            eye = pm.Body(*_PUPIL)
            eye.angle = base.angle
            self.space.add(eye, pm.DampedRotarySpring(base, eye, 0, 0.1, 3e-3))

    def _outlines(self, body, part):
        pm = self.of.pymunk
        if part.radius:
            self._add(pm.Circle(body, part.radius), part.friction, 1)
        for box in map(box_polygon, part.boxes):
            corners = [(float(x), float(y)) for x, y in zip(box.start.x, box.start.y, strict=True)]
            self._add(pm.Poly(body, corners), part.friction, 1)

    def play(self, command: Command, substeps: int, dt: float) -> None:
        """A control step of a command."""
        base = self.parts[0]
        for _ in range(substeps):
            self.control.angle = base.angle + command.turn
            way = -math.sin(base.angle), math.cos(base.angle)
            self.control.velocity = (way[0] * command.speed, way[1] * command.speed)
            for k, motor in enumerate(self.motors):
                error = self.parts[1 + k].angle - base.angle + (-1, 1)[k] * command.opening
                rate = min(max(10 * error, -1.0), 1.0)
                motor.rate = rate if abs(rate) >= 1e-4 else 0.0
            self.space.step(dt)

    def state(self) -> np.ndarray:
        """Poses and their rates (E, 6)."""
        bodies = self.parts + self.blocks
        return np.array(
            [[*b.position, b.angle, *b.velocity, b.angular_velocity] for b in bodies], np.float32
        )


class Chipmunk:
    """An engine for blocks of the given kinds; `pins` as in MAGICAL, else x-magical's pivots."""

    def __init__(self, robot: robots.Robot, kinds: tuple[str, ...], *, arena: float,
                 block_mass: float, pins: bool, control_hz: float = 8.0):  # fmt: skip
        self.pymunk, self.robot, self.kinds = _pymunk(), robot, kinds
        self.arena, self.block_mass, self.pins = arena, block_mass, pins
        self.substeps = 10
        self.dt = 1.0 / (control_hz * self.substeps)
        self._scenes: list[_Scene] = []

    def rest(self) -> Float[Array, "1"]:
        """The memory of an episode that has no scene yet."""
        return jnp.zeros(1)

    def step(self, pose, velocity, memory, shapes, strengths, command):
        """Poses, velocities and memory a control step later, as `Physics.step`."""
        del velocity, shapes
        like = [jax.ShapeDtypeStruct(x.shape, jnp.float32) for x in (pose, pose, memory)]
        one = lambda fields: jnp.stack([jnp.asarray(x, jnp.float32) for x in fields])  # noqa: E731
        numbers = [one(strengths), one(command)]
        return jax.pure_callback(
            self._play, like, pose, memory, *numbers, vmap_method="broadcast_all"
        )

    def _play(self, pose, memory, strengths, command):
        lanes = [np.asarray(f) for f in (pose, memory, strengths, command)]
        axes = (2, 1, 1, 1)
        flat = [f.reshape(-1, *f.shape[f.ndim - n :]) for f, n in zip(lanes, axes, strict=True)]
        new_pose, new_velocity, new_memory = [], [], []
        for at, number, force, order in zip(*flat, strict=True):
            if number[0] == 0:
                self._scenes.append(_Scene(self, at, Strengths(*force)))
                number = np.float32([len(self._scenes)])
            scene = self._scenes[int(number[0]) - 1]
            scene.play(Command(*map(float, order)), self.substeps, self.dt)
            state = scene.state()
            new_pose.append(state[:, :3])
            new_velocity.append(state[:, 3:])
            new_memory.append(number)
        shape = lanes[0].shape
        return (
            np.reshape(new_pose, shape), np.reshape(new_velocity, shape),
            np.reshape(new_memory, lanes[1].shape),
        )  # fmt: skip
