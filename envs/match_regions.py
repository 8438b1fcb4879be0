"""MatchRegions: put the green blocks, and only them, into the green region (MAGICAL's task in MJX).

A square arena |x|, |y| <= 1.1 seen from above; a disc robot with two fingers drives, turns and
grips; blocks slide on the table and stop at once when nothing pushes them. Control runs at 8 Hz.

Action (3,), each in [-1, 1]:
  0  forward speed, clipped to +-0.8 units/s
  1  turn. "original": x-magical's law, bang-bang beyond 0.0625; "smooth": linear to +-2.5 rad/s
  2  grip: the fingers aim at clip(pi/8 - a, 0, pi/8) rad; 0 or less opens them, 0.393 closes them
Observation (14 + 12 B,) for B blocks, lengths in arena units, "robot frame" turned with the robot:
  0-3    robot x, y, cos and sin of its heading angle
  4-6    forward and sideways speed (units/s), turn rate / 2.5 rad/s
  7      finger opening, 0 closed to 1 open
  8-13   region centre in the robot frame, region centre, width and height
  then for each block, targets first: centre in the robot frame (2), centre (2), offset to the
  region's centre (2), velocity (2), cos and sin of the angle, turn rate / 10,
  1 if inside the region
Objects: region, robot, targets, distractors, in that order.
Score: (n_t / T)(1 - n_d / (n_t + n_d)) with n_t targets and n_d distractors whose centre is in the
region. Success: score 1. Reward: x-magical's dense reward as its authors last selected it ("S4"),
10 tanh((-n_d + sum_i (D_i - d_i) - 0.1) / 2), d_i the distance of target i to the region's centre,
0 when inside, and D_i that distance at reset.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray
from mujoco import mjx

from . import match_regions_layout as layouts
from . import match_regions_scene as scene
from . import planar_model, shapes
from .base import Objects, Outline, State

__all__ = ["CLASSES", "MatchRegions", "PlanarData"]

COLOURS = ("green", "blue", "yellow", "red")
CLASSES = (
    "goal",
    "robot",
    *tuple(f"{c} {s}" for c in COLOURS for s in ("star", "square", "pentagon", "circle")),
)
TARGETS = ("green star", "green square")
DISTRACTORS = ("blue pentagon", "yellow circle", "yellow pentagon")
VARIANTS = ("demo", "jitter", "layout")

_MAX_SPEED, _MAX_TURN = 0.8, 2.5  # units/s, rad/s
_DRIVE_FORCE = 5.0
_TORQUES = np.array([1.0] + [planar_model.FINGER_TORQUE] * 2, np.float32)  # turning, fingers


class PlanarData(NamedTuple):
    """What the simulator must remember. Joint positions are the poses: see `planar_model`."""

    qpos: Float[Array, "Q"]  # robot x, y, yaw, left and right finger; then x, y, yaw a block
    qvel: Float[Array, "Q"]
    warmstart: Float[Array, "Q"]  # the solver's last acceleration
    goal: Float[Array, "4"]  # centre x, y; width, height
    start_distance: Float[Array, "K"]  # of each target to the region's centre at reset
    varied: Float[Array, ""]  # 1 in an episode that began with a varied start
    placed: Int[Array, ""]  # the block that such a start put into the region, or -1


def _rotate(angle: Float[Array, "..."], xy: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
    c, s = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([c * xy[..., 0] - s * xy[..., 1], s * xy[..., 0] + c * xy[..., 1]], axis=-1)


def _padded(outlines: list[np.ndarray]) -> np.ndarray:
    """Outlines as one array: a repeated vertex changes neither a box nor a polygon."""
    most = max(len(v) for v in outlines)
    return np.stack([np.concatenate([v, np.repeat(v[:1], most - len(v), 0)]) for v in outlines])


class MatchRegions:
    """The task; see the module's text for actions, observations and rewards.

    Args:
      targets, distractors: block names, "<colour> <shape>", from `CLASSES`.
      variant: start poses: "demo" (fixed), "jitter" (+-0.0275, +-9 degrees) or "layout" (anywhere).
      varied_starts: share of episodes that begin with the robot anywhere, and of those two in three
        with one target already in the region. For training; 0 is the task itself.
      turn: "original" or "smooth"; see above.
      substeps: physics steps a control step; the original's is 10.
      iterations: of the contact solver, each substep.
      max_contacts: most contacts that one substep resolves; the deepest count.
    """

    classes = CLASSES
    arena = 1.1
    half_extent = 1.122
    background = scene.BACKGROUND
    control_hz = 8.0
    action_size = 3

    def __init__(
        self,
        *,
        targets: tuple[str, ...] = TARGETS,
        distractors: tuple[str, ...] = DISTRACTORS,
        variant: str = "demo",
        varied_starts: float = 0.0,
        turn: str = "original",
        episode_length: int = 120,
        substeps: int = 5,
        iterations: int = 2,
        max_contacts: int = 16,
    ):
        if variant not in VARIANTS:
            raise ValueError(f"variant is {variant!r}, but must be one of {', '.join(VARIANTS)}")
        if turn not in ("original", "smooth"):
            raise ValueError(f"turn is {turn!r}, but must be 'original' or 'smooth'")
        for name in (*targets, *distractors):
            if name not in layouts.DEMO_BLOCKS and name not in CLASSES[2:]:
                raise ValueError(f"block {name!r} is not one of {', '.join(CLASSES[2:])}")
            if variant != "layout" and name not in layouts.DEMO_BLOCKS:
                raise ValueError(f"block {name!r} has no place in the {variant} layout")
        self.blocks = (*targets, *distractors)
        self.num_targets = len(targets)
        self.variant, self.varied_starts, self.episode_length = (
            variant,
            varied_starts,
            episode_length,
        )
        self.turn_gain = 40.0 if turn == "original" else _MAX_TURN
        self.substeps, self.dt = substeps, 1.0 / (self.control_hz * substeps)
        self.observation_size = 14 + 12 * len(self.blocks)

        robot = planar_model.gripper()
        block_shapes = [shapes.block(name.split()[1]) for name in self.blocks]
        self.mj_model = planar_model.build(
            robot,
            block_shapes,
            timestep=self.dt,
            iterations=iterations,
            max_contacts=max_contacts,
        )
        self._model = mjx.put_model(self.mj_model)
        self._blank = mjx.make_data(self._model)
        self._outlines = _padded([s.vertices for s in block_shapes])  # (B, V, 2)
        self._fingers = np.stack([shapes.finger(s).vertices for s in (-1, 1)])
        self._base = robot.base.vertices
        opened = jnp.array([0.0, 0.0, 0.0, planar_model.FINGER_OPEN, -planar_model.FINGER_OPEN])
        around = [np.asarray(self.robot_outline(opened)), *self._outlines]
        self._radii = np.array([np.linalg.norm(o, axis=1).max() for o in around])
        names = ["goal", "robot", *self.blocks]
        self._label = np.array([CLASSES.index(n) for n in names], np.int32)
        fingers = [self.mj_model.body(f"{side}_finger") for side in ("left", "right")]
        self._finger_com = np.stack([f.ipos[:2] for f in fingers])
        self._finger_inertia = float(fingers[0].inertia[0])

    # ---------------------------------------------------------------- episode

    def reset(self, key: PRNGKeyArray) -> State:
        """A new episode; two thirds of the varied starts have one target in the region."""
        key_layout, key_vary, key_start = jax.random.split(key, 3)
        demo = [
            layouts.DEMO_ROBOT,
            *(layouts.DEMO_BLOCKS.get(b, (0, 0, 0)) for b in self.blocks),
        ]
        poses, goal = jnp.array(demo), jnp.array(layouts.DEMO_GOAL)
        if self.variant == "jitter":
            poses, goal = layouts.jitter(key_layout, poses, goal, arena=self.arena)
        if self.variant == "layout":
            radii = jnp.asarray(self._radii, jnp.float32)
            poses, goal = layouts.scatter(key_layout, radii, arena=self.arena)
        start = self._distances(poses[1:], goal)
        vary, placed = jnp.zeros((), bool), jnp.full((), -1, jnp.int32)
        if self.varied_starts > 0:
            vary = jax.random.uniform(key_vary) < self.varied_starts
            varied, which = self._vary(key_start, poses, goal)
            poses = jnp.where(vary, varied, poses)
            placed = jnp.where(vary, which, placed)
        fingers = planar_model.FINGER_OPEN * jnp.array([1.0, -1.0])
        qpos = jnp.concatenate([poses[0], fingers, poses[1:].reshape(-1)])
        still = jnp.zeros_like(qpos)
        vary = vary.astype(jnp.float32)
        return self._observe(PlanarData(qpos, still, still, goal, start, vary, placed))

    def _vary(
        self, key: PRNGKeyArray, poses: Float[Array, "E 3"], goal: Float[Array, "4"]
    ) -> tuple[Float[Array, "E 3"], Int[Array, ""]]:
        """Robot anywhere; with probability 2/3 one target (which is returned) in the region."""
        key_robot, key_some, key_which, key_where = jax.random.split(key, 4)
        which = jax.random.randint(key_which, (), 0, self.num_targets)
        some = jax.random.uniform(key_some) < 2 / 3
        unit = jax.random.uniform(key_where, (3,), minval=-1.0)
        inside = jnp.concatenate([goal[:2] + 0.35 * goal[2:] * unit[:2], jnp.pi * unit[2:]])
        poses = jnp.where(some, poses.at[1 + which].set(inside), poses)
        radii = jnp.asarray(self._radii, jnp.float32)
        robot = layouts.place(
            key_robot,
            radii[0],
            poses,
            radii.at[0].set(0.0),
            goal,
            arena=self.arena,
            clear_of_goal=False,
        )
        return poses.at[0].set(robot), jnp.where(some, which, -1).astype(jnp.int32)

    def step(self, state: State, action: Float[Array, "3"]) -> State:
        """One control step: 1/8 s under a held action."""
        action = jnp.clip(action, -1.0, 1.0)

        def substep(carry, _):
            qpos, qvel, warmstart = carry
            data = self._blank.replace(
                qpos=qpos,
                qvel=qvel,
                qacc_warmstart=warmstart,
                qfrc_applied=self._drive(qpos, qvel, action),
            )
            model = self._model.replace(jnt_range=self._joint_range(qpos))
            data = mjx.step(model, data)
            return (data.qpos, data.qvel, data.qacc), None

        data = state.data
        carry = (data.qpos, data.qvel, data.warmstart)
        (qpos, qvel, warmstart), _ = jax.lax.scan(substep, carry, length=self.substeps)
        return self._observe(data._replace(qpos=qpos, qvel=qvel, warmstart=warmstart))

    # ---------------------------------------------------------------- physics

    def _drive(
        self, qpos: Float[Array, "Q"], qvel: Float[Array, "Q"], action: Float[Array, "3"]
    ) -> Float[Array, "Q"]:
        """Forces of the drive: servos towards a velocity, each within its largest force.

        Chipmunk couples the robot to a kinematic body by force-limited joints. The force that
        reaches the target velocity in one substep, clipped, is the same law. It takes the whole
        inertia matrix: servos on each joint alone would shake the light fingers.
        """
        forward = jnp.clip(action[0], -_MAX_SPEED, _MAX_SPEED)
        yaw = qpos[2] + self.dt * qvel[2]  # Chipmunk turns the robot before it pushes
        heading = jnp.stack([-jnp.sin(yaw), jnp.cos(yaw)])
        turn = jnp.clip(self.turn_gain * action[1], -_MAX_TURN, _MAX_TURN)
        opening = jnp.clip(planar_model.FINGER_OPEN - action[2], 0.0, planar_model.FINGER_OPEN)
        rate = 10.0 * (opening * jnp.array([1.0, -1.0]) - qpos[3:5])
        rate = jnp.clip(rate, -planar_model.FINGER_RATE, planar_model.FINGER_RATE)
        target = jnp.concatenate([forward * heading, turn[None], rate])

        force = self._robot_mass(qpos) @ (target - qvel[:5]) / self.dt
        size = jnp.sqrt(jnp.sum(force[:2] ** 2) + 1e-12)
        push = force[:2] * jnp.minimum(1.0, _DRIVE_FORCE / size)
        torque = jnp.clip(force[2:], -_TORQUES, _TORQUES)
        return jnp.zeros_like(qpos).at[:5].set(jnp.concatenate([push, torque]))

    def _robot_mass(self, qpos: Float[Array, "Q"]) -> Float[Array, "5 5"]:
        """Joint-space inertia of disc and fingers: x, y, yaw, left finger, right finger."""
        mass, inertia = planar_model.FINGER_MASS, self._finger_inertia
        pivots = jnp.array([[-planar_model.PIVOT[0], planar_model.PIVOT[1]], planar_model.PIVOT])
        from_pivot = _rotate(qpos[3:5], jnp.asarray(self._finger_com, jnp.float32))
        arm = _rotate(qpos[2], pivots + from_pivot)  # robot's centre to finger's centre of mass
        hand = _rotate(qpos[2], from_pivot)
        across = mass * jnp.stack([-arm[:, 1], arm[:, 0]])  # (2 axes, 2 fingers)
        swing = mass * jnp.stack([-hand[:, 1], hand[:, 0]])
        yaw = jnp.sum(inertia + mass * jnp.sum(arm**2, axis=1)) + planar_model.DISC_INERTIA
        coupling = inertia + mass * jnp.sum(arm * hand, axis=1)
        armature = planar_model.finger_armature(self.dt)
        finger = jnp.diag(inertia + mass * jnp.sum(hand**2, axis=1) + armature)
        whole = (planar_model.DISC_MASS + 2 * mass) * jnp.eye(2)
        across_yaw = across.sum(axis=1, keepdims=True)
        return jnp.block(
            [
                [whole, across_yaw, swing],
                [across_yaw.T, yaw[None, None], coupling[None]],
                [swing.T, coupling[:, None], finger],
            ]
        )

    def _joint_range(self, qpos: Float[Array, "Q"]) -> Float[Array, "Q 2"]:
        """Walls: how far each body's centre may go at its present angle."""
        low, high = self._extents(qpos)
        limits = jnp.stack([-self.arena - low, self.arena - high], axis=-1)  # (1 + B, 2, 2)
        free = jnp.broadcast_to(jnp.array([-1e3, 1e3]), (limits.shape[0], 1, 2))
        limits = jnp.concatenate([limits, free], axis=1)
        fingers = planar_model.FINGER_OPEN * jnp.array([[0.0, 1.0], [-1.0, 0.0]])
        return jnp.concatenate([limits[0], fingers, limits[1:].reshape(-1, 2)])

    def _extents(self, qpos: Float[Array, "Q"]) -> tuple[Float[Array, "E 2"], Float[Array, "E 2"]]:
        """Lowest and highest corner of robot and blocks, relative to their centres."""
        angles = qpos[5:].reshape(-1, 3)[:, 2]
        turned = _rotate(angles[:, None], jnp.asarray(self._outlines, jnp.float32))
        robot = self.robot_outline(qpos)
        low = jnp.concatenate([robot.min(axis=0)[None], turned.min(axis=1)])
        return low, jnp.concatenate([robot.max(axis=0)[None], turned.max(axis=1)])

    def robot_outline(self, qpos: Float[Array, "Q"]) -> Float[Array, "V 2"]:
        """Corners of disc and fingers relative to the robot's centre, world axes."""
        pivots = jnp.array([[-planar_model.PIVOT[0], planar_model.PIVOT[1]], planar_model.PIVOT])
        fingers = _rotate(qpos[3:5, None], jnp.asarray(self._fingers, jnp.float32))
        fingers = (fingers + pivots[:, None]).reshape(-1, 2)
        return _rotate(qpos[2], jnp.concatenate([jnp.asarray(self._base, jnp.float32), fingers]))

    # ---------------------------------------------------------------- what is seen

    def _distances(self, blocks: Float[Array, "B 3"], goal: Float[Array, "4"]) -> Float[Array, "K"]:
        offset = blocks[: self.num_targets, :2] - goal[:2]
        return jnp.sqrt(jnp.sum(offset**2, axis=1) + 1e-12)

    def _inside(self, blocks: Float[Array, "B 3"], goal: Float[Array, "4"]) -> Bool[Array, "B"]:
        return (jnp.abs(blocks[:, :2] - goal[:2]) <= goal[2:] / 2).all(axis=1)

    def _observe(self, data: PlanarData) -> State:
        blocks = data.qpos[5:].reshape(-1, 3)
        inside = self._inside(blocks, data.goal)
        n_t = jnp.sum(inside[: self.num_targets]).astype(jnp.float32)
        n_d = jnp.sum(inside[self.num_targets :]).astype(jnp.float32)
        score = n_t / self.num_targets * (1 - n_d / jnp.maximum(n_t + n_d, 1.0))
        distance = jnp.where(inside[: self.num_targets], 0.0, self._distances(blocks, data.goal))
        progress = jnp.sum(data.start_distance - distance)
        return State(
            data=data,
            obs=self._observation(data, blocks, inside),
            objects=self._objects(data, blocks),
            moved=jnp.arange(2 + len(self.blocks))
            == jnp.where(data.placed < 0, -1, 2 + data.placed),
            reward=10.0 * jnp.tanh((progress - n_d - 0.1) / 2),
            done=jnp.zeros(()),
            metrics={
                "score": score,
                "success": (score > 0.999).astype(jnp.float32),
                "varied": data.varied,
            },
        )

    def _objects(self, data: PlanarData, blocks: Float[Array, "B 3"]) -> Objects:
        angles = blocks[:, 2:3]
        turned = _rotate(angles, jnp.asarray(self._outlines, jnp.float32))
        size = turned.max(axis=1) - turned.min(axis=1)
        # The robot's box is its disc: what a detector sees once the fingers are filtered away.
        return Objects(
            center=jnp.concatenate([data.goal[None, :2], data.qpos[None, :2], blocks[:, :2]]),
            size=jnp.concatenate([data.goal[None, 2:], jnp.full((1, 2), 0.4), size]),
            label=jnp.asarray(self._label),
            is_robot=jnp.arange(len(self._label)) == 1,
        )

    def _observation(
        self, data: PlanarData, blocks: Float[Array, "B 3"], inside: Bool[Array, "B"]
    ) -> Float[Array, "O"]:
        x_y, yaw, velocity = data.qpos[:2], data.qpos[2], data.qvel[:3]
        opening = (data.qpos[3] - data.qpos[4]) / (2 * planar_model.FINGER_OPEN)
        robot = [
            x_y,
            jnp.stack([jnp.cos(yaw), jnp.sin(yaw)]),
            _rotate(-yaw, velocity[:2])[::-1],
            velocity[2:] / _MAX_TURN,
            opening[None],
            _rotate(-yaw, data.goal[:2] - x_y),
            data.goal,
        ]
        speed = data.qvel[5:].reshape(-1, 3)
        each = [
            _rotate(-yaw, blocks[:, :2] - x_y),
            blocks[:, :2],
            blocks[:, :2] - data.goal[:2],
            speed[:, :2],
            jnp.stack([jnp.cos(blocks[:, 2]), jnp.sin(blocks[:, 2]), speed[:, 2] / 10.0], axis=1),
            inside.astype(jnp.float32)[:, None],
        ]
        return jnp.concatenate([*robot, jnp.concatenate(each, axis=1).reshape(-1)])

    def outlines(self, data: PlanarData) -> list[Outline]:
        """What to paint for one moment (host side)."""
        qpos, goal = np.asarray(data.qpos, np.float64), np.asarray(data.goal, np.float64)
        return scene.outlines(self.blocks, self.arena, qpos, goal)
