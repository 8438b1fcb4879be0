"""The second engine of a planar scene: the gripper and blocks of fixed shapes, in MuJoCo MJX.

Its interface is that of `physics.Physics`, its model that of `model`. What MuJoCo has no equal for
is computed each substep: the drive as forces, the walls as ranges of joints, and the table's
friction, a disc in the original, as a loss on each axis that follows the direction of travel.
"""

import contextlib
import io

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import joints as jointing
from . import model as planar_model
from . import robots
from . import shapes as block_shapes
from .contacts import frames
from .joints import Command, Strengths
from .physics import Physics
from .plane import Vec, heading
from .shapes import BlockShape

with contextlib.redirect_stdout(io.StringIO()):  # it reports on parts that are not installed
    from mujoco import mjx

_PARTS, _JOINTS = 3, 5  # of the gripper: base and fingers; x, y, yaw and the fingers' angles
_SLOW = 1e-3  # units/s; below it the direction of travel means nothing
_LEAST_LOSS = 0.02  # share of the table's force; MuJoCo's rows must not vanish
_FREE = 1e3  # a range that no angle reaches, rad


class MjxPhysics:
    """The gripper among blocks, whose shapes are of `shapes.SHAPES`, in a square of side 2 `arena`.

    Iterations are those of MuJoCo's Newton solver in each of the substeps of a control step.
    """

    def __init__(
        self,
        blocks: tuple[str, ...],
        *,
        arena: float,
        control_hz: float = 8.0,
        substeps: int = 5,
        iterations: int = 2,
    ):
        self.arena, self.substeps = arena, substeps
        self.dt = 1.0 / (control_hz * substeps)
        self._ahead = 0.5 - 0.05 * substeps if substeps < 10 else 0.0
        self.mj_model = planar_model.build(blocks, timestep=self.dt, iterations=iterations)
        self._model = mjx.put_model(self.mj_model, impl="jax")
        self._blank = mjx.make_data(self._model, impl="jax")
        robot = robots.robot("gripper")
        self._outlines = Physics(robot, len(blocks), arena=arena)  # which has no capsules
        self._base, self._finger, right = robot.parts  # the right one weighs the same
        self._turns = self._finger.inertia, right.inertia
        corners = np.stack([self._finger.corners, right.corners]).astype(np.float32)
        self._corners = Vec(corners[..., 0], corners[..., 1])  # (2, C)

    def rest(self) -> Float[Array, "I"]:
        """The memory of a scene in which nothing has touched yet."""
        return jnp.zeros(self.mj_model.nv)

    def step(
        self, pose, velocity, memory, shapes: BlockShape, strengths: Strengths, command: Command
    ) -> tuple[Float[Array, "E 3"], Float[Array, "E 3"], Float[Array, "I"]]:
        """One control step, as `Physics.step`.

        Shapes are those that the model was built for; the memory is the last accelerations.
        """
        dt, ahead = self.dt, self._ahead

        def substep(carry, _):
            before, rate, memory = carry
            place = before + dt * (1 - ahead) * rate
            force = self._drive(before, place, rate, strengths, command)
            memory = self._acceleration(place, rate, memory, force, shapes, strengths)
            rate = rate + dt * memory
            return (place + dt * ahead * rate, rate, memory), None

        carry, _ = jax.lax.scan(substep, (*_joints(pose, velocity), memory), length=self.substeps)
        return *_poses(*carry[:2]), carry[2]

    def settle(
        self, pose, velocity, shapes: BlockShape, strengths: Strengths, command: Command
    ) -> Float[Array, "I"]:
        """The memory of a scene that `command` has just brought here, as `Physics.settle`."""
        place, rate = _joints(pose, velocity)
        force = self._drive(place - self.dt * rate, place, rate, strengths, command)
        return self._acceleration(place, rate, self.rest(), force, shapes, strengths)

    def clearance(self, pose: Float[Array, "E 3"], shapes: BlockShape) -> Float[Array, ""]:
        """The gap that `Physics.clearance` gives: that between the true outlines."""
        return self._outlines.clearance(pose, shapes)

    def _acceleration(self, place, rate, memory, force, shapes, strengths) -> Float[Array, "Q"]:
        """Accelerations that MuJoCo's solver finds for joints at `place` that move at `rate`."""
        model = self._model.replace(
            jnt_range=self._ranges(place, shapes), dof_frictionloss=_losses(rate, strengths)
        )
        force = jnp.concatenate([force, jnp.zeros(len(place) - _JOINTS)])
        data = self._blank.replace(qpos=place, qvel=rate, qacc_warmstart=memory, qfrc_applied=force)
        return mjx.forward(model, data).qacc

    def _drive(self, before, place, rate, strengths: Strengths, command: Command):
        """Forces (5,) on the gripper's joints: velocity servos, each limited to its strength.

        The force that reaches the aim in one substep takes the whole inertia matrix: servos on each
        joint alone would shake the light fingers.
        """
        parts, now = (_poses(at, rate)[0][:_PARTS] for at in (before, place))
        aim = jointing.aims(parts, now, frames(now), rate[2], command, dt=self.dt)
        # The original's aim jumps from substep to substep about half the offset's rate. Here that
        # mean is aimed at: over an odd number of longer substeps the jumps do not even out.
        turn = jnp.clip(command.turn / (2 * self.dt), -jointing.TURN_RATE, jointing.TURN_RATE)
        wanted = jnp.concatenate([jnp.stack([aim.drive.x, aim.drive.y, turn]), aim.rate])
        mass, missing = self._inertia(place[2]), wanted - rate[:_JOINTS]
        # A blocked finger misses 1 rad/s at most. One that turns back misses more, and may take
        # what its rotor needs, because the original has none.
        grip = strengths.finger * jnp.maximum(1.0, jnp.abs(missing[3:]))

        def limited(force: Float[Array, "5"]) -> Float[Array, "5"]:
            share = jnp.minimum(1.0, strengths.drive / jnp.sqrt(jnp.sum(force[:2] ** 2) + 1e-12))
            turned = jnp.clip(force[2:3], -strengths.turn, strengths.turn)
            gripped = jnp.clip(force[3:], -grip, grip)
            return jnp.concatenate([share * force[:2], turned, gripped])

        speedup = missing / self.dt
        # A joint at its limit accelerates less, and then the others need other forces.
        for _ in range(2):
            force = mass @ speedup
            speedup = speedup + (limited(force) - force) / jnp.diagonal(mass)
        return limited(mass @ speedup)

    def _inertia(self, yaw: Float[Array, ""]) -> Float[Array, "5 5"]:
        """Joint-space inertia of the gripper: x, y, yaw, left finger, right finger."""
        mass, (left, right) = self._finger.mass, self._turns
        arm = _arms(yaw)
        whole = self._base.mass + 2 * mass
        x, y = -mass * arm.y.sum(), mass * arm.x.sum()  # how turning pulls at x and y
        yaw_yaw = self._base.inertia + left + right + mass * arm.dot(arm).sum()
        rotor = planar_model.finger_armature(self.dt)
        return jnp.array([
            [whole, 0.0, x, 0.0, 0.0], [0.0, whole, y, 0.0, 0.0], [x, y, yaw_yaw, left, right],
            [0.0, 0.0, left, left + rotor, 0.0], [0.0, 0.0, right, 0.0, right + rotor],
        ])  # fmt: skip

    def _ranges(self, place: Float[Array, "Q"], shapes: BlockShape) -> Float[Array, "Q 2"]:
        """Joint ranges for walls and stops at the bodies' present angles."""
        low, high = block_shapes.extents(shapes, place[_JOINTS + 2 :: 3])
        points = self._tips(place)
        disc = self._base.radius
        low = jnp.concatenate([jnp.minimum(points.min(axis=0), -disc)[None], low])
        high = jnp.concatenate([jnp.maximum(points.max(axis=0), disc)[None], high])
        slides = jnp.stack([-self.arena - low, self.arena - high], axis=-1)  # (1 + B, 2, 2)
        turns = jnp.broadcast_to(jnp.array([-_FREE, _FREE]), (len(slides), 1, 2))
        free = jnp.concatenate([slides, turns], axis=1)
        stops = robots.FINGER_OPEN * jnp.array([[0.0, 1.0], [-1.0, 0.0]])
        return jnp.concatenate([free[0], stops, free[1:].reshape(-1, 2)])

    def _tips(self, place: Float[Array, "Q"]) -> Float[Array, "C 2"]:
        """Both fingers' corners relative to the base's centre, world axes."""
        arm, turned = _arms(place[2]), heading((place[2] + place[3:_JOINTS])[:, None])
        corners = self._corners.out_of(turned)
        x, y = arm.x[:, None] + corners.x, arm.y[:, None] + corners.y
        return jnp.stack([x.reshape(-1), y.reshape(-1)], axis=-1)


def _arms(yaw: Float[Array, ""]) -> Vec:
    """Vectors from the base's centre to the left and the right pivot, world axes."""
    return Vec(*robots.PIVOTS.T.astype(np.float32)).out_of(heading(yaw))


def _joints(pose: Float[Array, "E 3"], velocity: Float[Array, "E 3"]) -> tuple[Array, Array]:
    """Joint positions and rates (Q,) from poses and velocities of parts and blocks."""

    def joined(rows):
        fingers = rows[1:_PARTS, 2] - rows[0, 2]
        return jnp.concatenate([rows[0], fingers, rows[_PARTS:].reshape(-1)])

    return joined(pose), joined(velocity)


def _poses(place: Float[Array, "Q"], rate: Float[Array, "Q"]) -> tuple[Array, Array]:
    """Poses and velocities (E, 3) from joints and their rates; fingers sit on their pivots."""
    arm = _arms(place[2])
    swing = arm.turned() * rate[2]

    def rows(joints, offset):
        x, y, turn = joints[:3]
        fingers = jnp.stack([x + offset.x, y + offset.y, turn + joints[3:_JOINTS]], axis=-1)
        return jnp.concatenate([joints[None, :3], fingers, joints[_JOINTS:].reshape(-1, 3)])

    return rows(place, arm), rows(rate, swing)


def _losses(rate: Float[Array, "Q"], strengths: Strengths) -> Float[Array, "Q"]:
    """The table's friction on each joint, along the blocks' directions of travel."""
    travel = rate[_JOINTS:].reshape(-1, 3)[:, :2]
    speed = jnp.sqrt(jnp.sum(travel**2, axis=1, keepdims=True) + 1e-12)
    share = jnp.where(speed > _SLOW, jnp.abs(travel) / speed, 0.75)
    force = strengths.table * jnp.maximum(share, _LEAST_LOSS)
    turn = jnp.broadcast_to(strengths.table_turn, (len(travel), 1))
    losses = jnp.concatenate([force, turn], axis=1).reshape(-1)
    return jnp.concatenate([jnp.zeros(_JOINTS), losses])
