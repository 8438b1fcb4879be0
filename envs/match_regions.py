"""MatchRegions: put the green blocks, and only them, into the green region (MAGICAL's task).

A square arena |x|, |y| <= 1.1 seen from above; a robot drives, turns and, if it has fingers, grips;
blocks slide on the table and stop at once when nothing pushes them. Control runs at 8 Hz.

Action (3,), or (2,) for a stick, each in [-1, 1]:
  0  forward speed, clipped to +-0.8 units/s
  1  turn. "original": x-magical's law, bang-bang beyond 0.0625; "smooth": linear to +-2.5 rad/s
  2  grip: the fingers aim at clip(pi/8 - a, 0, pi/8) rad; 0 or less opens them, 0.393 closes them
Observation: see `match_regions_observation`; `observation_names` says what each number is.
Objects: region, robot, targets, distractors, in that order.
Score, success (score 1) and the dense rewards: see `match_regions_reward`.

Physics presets:
  "xmagical"  arena 1.1, block mass 0.01, drive force 5: blocks stop within a hundredth of a second
  "magical"   the original MAGICAL's: arena 1.0, block mass 0.5, drive force 3, so blocks coast; the
              action is rounded to its 18: forward 0.8, stop, or reverse 0.6; left, none or right;
              open or closed

Engines: "impulse", our own solver (`planar_physics`), which follows the original closely and serves
every option; or "mjx", MuJoCo's (`planar_mjx`), which serves the gripper, fixed shapes and
"xmagical" physics.
"""

import difflib
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import block_shapes, raster, robots
from . import match_regions_layout as layouts
from . import match_regions_observation as observations
from . import match_regions_reward as rewards
from . import match_regions_scene as scene
from .base import Objects, Outline, State
from .joints import TURN_RATE, Command, Strengths
from .planar_mjx import MjxPhysics
from .planar_physics import Physics

__all__ = ["CLASSES", "PRESETS", "MatchRegions", "PlanarData"]

COLOURS, SHAPES = layouts.COLOURS, block_shapes.SHAPES
CLASSES = ("goal", "robot", *tuple(f"{c} {s}" for c in COLOURS for s in SHAPES))
TARGETS = ("green star", "green square")
DISTRACTORS = ("blue pentagon", "yellow circle", "yellow pentagon")


class _Preset(NamedTuple):
    arena: float
    block_mass: float
    strengths: Strengths
    reverse: float  # fastest backwards, units/s


PRESETS = {
    "xmagical": _Preset(1.1, 0.01, Strengths(5.0, 1.0, 4.0, 1.5, 0.1), 0.8),
    "magical": _Preset(1.0, 0.5, Strengths(3.0, 1.0, 4.0, 1.5, 0.1), 0.6),
}
_MAX_SPEED = 0.8  # units/s
_SOLVING = {"impulse": (10, 6), "mjx": (5, 2)}  # substeps and iterations of each engine


class PlanarData(NamedTuple):
    """What the simulator must remember; E bodies are the robot's parts, then B blocks."""

    pose: Float[Array, "E 3"]  # x, y (arena units), angle (rad); a finger's place is its pivot
    velocity: Float[Array, "E 3"]  # per second
    memory: Float[Array, "I"]  # what the engine's solver begins with
    shape: Int[Array, "B"]  # of each block, an index into `block_shapes.SHAPES`
    colour: Int[Array, "B"]  # an index into COLOURS; the region has the first target's
    strengths: Float[Array, "5"]  # the fields of `joints.Strengths`
    goal: Float[Array, "4"]  # centre x, y; width, height
    start_distance: Float[Array, "K"]  # of each target to the region's centre at reset
    nearest: Float[Array, "K"]  # of each target to the robot since reset
    unplaced: Bool[Array, ""]  # the layout found no free place for something
    varied: Float[Array, ""]  # 1 in an episode that began with a varied start
    placed: Int[Array, ""]  # the block that such a start put into the region, or -1


class MatchRegions:
    """The task; see the module's text for actions, observations and rewards.

    Args:
      robot: "gripper", or a stick: "short", "medium" or "long".
      physics: the preset, "xmagical" or "magical"; see above.
      engine: "impulse" or "mjx"; see above.
      targets, distractors: block names, "<colour> <shape>", from `CLASSES`.
      variant: what is drawn at reset: nothing ("demo"), a little of everything ("jitter",
        +-0.0275 and +-9 degrees), places ("layout"), colours ("color"), shapes ("shape"), forces
        ("dynamics"), or the last four together ("all").
      varied_starts: share of episodes that begin with the robot anywhere, and of those two in three
        with one target already in the region. For training; 0 is the task itself.
      turn: "original" or "smooth"; see above.
      observation: "rich" or "xmagical".
      reward: the task's own reward: "S4", "V5", "S3" or "sparse".
      substeps: physics steps a control step; the original's is 10. None is the engine's own
        choice: 10, or 5 with "mjx".
      iterations: sweeps of the solver a substep; the original's is 10. None: 6, or 2 with "mjx".
    """

    classes = CLASSES
    background = scene.BACKGROUND
    control_hz = 8.0

    def __init__(
        self,
        *,
        robot: str = "gripper",
        physics: str = "xmagical",
        engine: str = "impulse",
        targets: tuple[str, ...] = TARGETS,
        distractors: tuple[str, ...] = DISTRACTORS,
        variant: str = "demo",
        varied_starts: float = 0.0,
        turn: str = "original",
        observation: str = "rich",
        reward: str = "S4",
        episode_length: int = 120,
        substeps: int | None = None,
        iterations: int | None = None,
    ):
        _check("robot", robot, robots.ROBOTS)
        _check("physics", physics, tuple(PRESETS))
        _check("engine", engine, tuple(_SOLVING))
        _check("variant", variant, layouts.VARIANTS)
        _check("turn", turn, ("original", "smooth"))
        _check("observation", observation, observations.OBSERVATIONS)
        _check("reward", reward, rewards.REWARDS)
        if not targets:
            raise ValueError("targets is empty, but needs at least one block")
        if not 0 <= varied_starts <= 1:
            raise ValueError(f"varied_starts is {varied_starts}, but must be between 0 and 1")
        if engine == "mjx":
            _check_mjx(robot, physics, variant)
        substeps = _SOLVING[engine][0] if substeps is None else substeps
        iterations = _SOLVING[engine][1] if iterations is None else iterations
        for count, what in ((episode_length, "episode_length"), (substeps, "substeps"),
                            (iterations, "iterations")):  # fmt: skip
            if count < 1:
                raise ValueError(f"{what} is {count}, but must be at least 1")
        scattered = variant in ("layout", "all")
        for name in (*targets, *distractors):
            _check("block", name, CLASSES[2:])
            if not scattered and name not in layouts.DEMO_BLOCKS:
                raise ValueError(f"block {name!r} has no place in the {variant} layout")
        self.blocks = (*targets, *distractors)
        self.num_targets, self.variant = len(targets), variant
        self.varied_starts, self.episode_length = varied_starts, episode_length
        self.turn_gain = 40.0 if turn == "original" else TURN_RATE
        self.robot, self.physics = robots.robot(robot), physics
        self.action_size = 3 if self.robot.has_fingers else 2
        self._preset = PRESETS[physics]
        self.arena = self._preset.arena
        self.half_extent = 1.02 * self.arena
        self._reward, self._kind = reward, observation
        self._parts = len(self.robot.parts)
        self.observation_names = observations.names(
            observation, self.blocks, fingers=self.robot.has_fingers, targets=len(targets)
        )
        self.observation_size = len(self.observation_names)
        self.action_names = ("forward speed", "turn", "grip")[: self.action_size]
        split = [name.split() for name in self.blocks]
        self._colour = np.array([COLOURS.index(c) for c, _ in split], np.int32)
        self._shape = np.array([SHAPES.index(s) for _, s in split], np.int32)
        self._engine = self._make_engine(engine, substeps, iterations)
        self._rest = np.asarray(self._engine.rest())

    def _make_engine(self, engine: str, substeps: int, iterations: int):
        common = dict(
            arena=self.arena, control_hz=self.control_hz, substeps=substeps, iterations=iterations
        )
        if engine == "impulse":
            count, mass = len(self.blocks), self._preset.block_mass
            return Physics(self.robot, count, block_mass=mass, **common)
        return MjxPhysics(tuple(SHAPES[s] for s in self._shape), **common)

    # ---------------------------------------------------------------- episode

    def reset(self, key: PRNGKeyArray) -> State:
        """A new episode of the task's variant."""
        keys = jax.random.split(key, 6)
        shape, colour = jnp.asarray(self._shape), jnp.asarray(self._colour)
        strengths = Strengths(*(jnp.float32(s) for s in self._preset.strengths))
        if self.variant in ("shape", "all"):
            shape = layouts.shapes(keys[0], len(self.blocks))
        if self.variant in ("color", "all"):
            colour = layouts.colours(keys[1], colour, self.num_targets)
        if self.variant in ("dynamics", "all"):
            strengths = layouts.dynamics(keys[2])
        layout = self._layout(keys[3], jnp.asarray(layouts.RADII)[shape])
        start = _distances(layout.blocks[: self.num_targets], layout.goal[:2])
        layout, vary, placed = self._vary(keys[4:], layout, jnp.asarray(layouts.RADII)[shape])
        pose = jnp.concatenate([self._robot_pose(layout.robot), layout.blocks])
        nearest = _distances(layout.blocks[: self.num_targets], layout.robot[:2])
        data = PlanarData(
            pose, jnp.zeros_like(pose), jnp.asarray(self._rest), shape, colour,
            jnp.stack(strengths), layout.goal, start, nearest, layout.unplaced,
            vary.astype(jnp.float32), placed,
        )  # fmt: skip
        return self._observe(data)

    def reset_to(
        self,
        pose: Float[Array, "E 3"],
        velocity: Float[Array, "E 3"],
        *,
        goal: Float[Array, "4"] | None = None,
        start: Float[Array, "K 2"] | None = None,
        action: Float[Array, "A"] | None = None,
    ) -> State:
        """The state with given poses and velocities of the robot, its fingers and the blocks.

        Args:
          pose: x, y, angle of each body, in the order of `PlanarData`.
          velocity: their rates.
          goal: centre x, y, width, height of the region; None is the Demo layout's.
          start: where the targets were at reset, which S4 counts from; None is where they are.
          action: what brought the scene here. The solver then starts with the impulses that it
            would have given; None starts with none, as after a reset.
        """
        goal = jnp.array(layouts.DEMO_GOAL) if goal is None else goal
        targets = pose[self._parts : self._parts + self.num_targets]
        strengths = Strengths(*(jnp.float32(s) for s in self._preset.strengths))
        memory = jnp.asarray(self._rest)
        if action is not None:
            shapes = block_shapes.blocks(jnp.asarray(self._shape))
            command = self._command(jnp.clip(action, -1.0, 1.0))
            memory = self._engine.settle(pose, velocity, shapes, strengths, command)
        data = PlanarData(
            pose, velocity, memory, jnp.asarray(self._shape), jnp.asarray(self._colour),
            jnp.stack(strengths), goal, _distances(targets if start is None else start, goal[:2]),
            _distances(targets, pose[0, :2]), jnp.zeros((), bool), jnp.zeros(()),
            jnp.full((), -1, jnp.int32),
        )  # fmt: skip
        return self._observe(data)

    def clearance(self, pose: Float[Array, "E 3"]) -> Float[Array, ""]:
        """Gap between the robot and the nearest block or wall, for the task's own shapes."""
        return self._engine.clearance(pose, block_shapes.blocks(jnp.asarray(self._shape)))

    def step(self, state: State, action: Float[Array, "A"]) -> State:
        """One control step: 1/8 s under a held action."""
        data = state.data
        # Shapes that never change are constants of the compiled program.
        shape = data.shape if self.variant in ("shape", "all") else jnp.asarray(self._shape)
        pose, velocity, memory = self._engine.step(
            data.pose,
            data.velocity,
            data.memory,
            block_shapes.blocks(shape),
            Strengths(*data.strengths),
            self._command(jnp.clip(action, -1.0, 1.0)),
        )
        targets = pose[self._parts : self._parts + self.num_targets]
        nearest = jnp.minimum(data.nearest, _distances(targets, pose[0, :2]))
        return self._observe(
            data._replace(pose=pose, velocity=velocity, memory=memory, nearest=nearest)
        )

    def _command(self, action: Float[Array, "A"]) -> Command:
        grip = action[2] if self.robot.has_fingers else jnp.zeros(())
        if self.physics == "magical":
            speed = jnp.where(action[0] > 0.5, _MAX_SPEED, 0.0)
            speed = jnp.where(action[0] < -0.5, -self._preset.reverse, speed)
            turn = jnp.where(jnp.abs(action[1]) > 0.5, 1.5 * jnp.sign(action[1]), 0.0)
            return Command(speed, turn, jnp.where(grip > 0, 0.0, robots.FINGER_OPEN))
        speed = jnp.clip(action[0], -self._preset.reverse, _MAX_SPEED)
        opening = jnp.clip(robots.FINGER_OPEN - grip, 0.0, robots.FINGER_OPEN)
        # A heading offset of a turns at a / (2 dt), because half of it is done when the servo acts.
        return Command(speed, 2 * self._engine.dt * self.turn_gain * action[1], opening)

    # ---------------------------------------------------------------- start

    def _layout(self, key: PRNGKeyArray, radii: Float[Array, "B"]) -> layouts.Layout:
        if self.variant in ("layout", "all"):
            return layouts.scatter(key, self.robot, radii, arena=self.arena)
        blocks = jnp.array([layouts.DEMO_BLOCKS[b] for b in self.blocks])
        robot, goal = jnp.array(layouts.DEMO_ROBOT), jnp.array(layouts.DEMO_GOAL)
        layout = layouts.Layout(robot, blocks, goal, jnp.zeros((), bool))
        if self.variant == "jitter":
            layout = layouts.jitter(key, layout, arena=self.arena)
        return layout

    def _vary(self, keys, layout: layouts.Layout, radii: Float[Array, "B"]):
        """Perhaps the robot anywhere and, two times in three, one target in the region."""
        none = jnp.full((), -1, jnp.int32)
        if not self.varied_starts:
            return layout, jnp.zeros((), bool), none
        vary = jax.random.uniform(keys[0]) < self.varied_starts
        key_robot, key_some, key_which, key_where = jax.random.split(keys[1], 4)
        which = jax.random.randint(key_which, (), 0, self.num_targets, jnp.int32)
        some = vary & (jax.random.uniform(key_some) < 2 / 3)
        unit = jax.random.uniform(key_where, (3,), minval=-1.0)
        goal = layout.goal
        inside = jnp.concatenate([goal[:2] + 0.35 * goal[2:] * unit[:2], jnp.pi * unit[2:]])
        blocks = jnp.where(some, layout.blocks.at[which].set(inside), layout.blocks)
        pose, unplaced = layouts.place_robot(
            key_robot, self.robot, blocks, radii, None, arena=self.arena
        )
        layout = layout._replace(
            robot=jnp.where(vary, pose, layout.robot),
            blocks=blocks,
            unplaced=layout.unplaced | (vary & unplaced),
        )
        return layout, vary, jnp.where(some, which, none)

    def _robot_pose(self, base: Float[Array, "3"]) -> Float[Array, "P 3"]:
        """The robot's parts with open fingers."""
        if not self.robot.has_fingers:
            return base[None]
        c, s = jnp.cos(base[2]), jnp.sin(base[2])
        pivots = jnp.asarray(robots.PIVOTS, jnp.float32) @ jnp.array([[c, s], [-s, c]])
        angle = base[2] + robots.FINGER_OPEN * jnp.array([1.0, -1.0])
        fingers = jnp.concatenate([base[:2] + pivots, angle[:, None]], axis=1)
        return jnp.concatenate([base[None], fingers])

    # ---------------------------------------------------------------- what is seen

    def _observe(self, data: PlanarData) -> State:
        blocks = data.pose[self._parts :]
        inside = (jnp.abs(blocks[:, :2] - data.goal[:2]) <= data.goal[2:] / 2).all(axis=1)
        targets = blocks[: self.num_targets]
        progress = rewards.Progress(
            inside=inside,
            distance=_distances(targets, data.goal[:2]),
            start=data.start_distance,
            reach=_distances(targets, data.pose[0, :2]),
            nearest=data.nearest,
        )
        score = rewards.score(progress)
        seen = observations.Scene(data.pose, data.velocity, data.goal, inside)
        block = jnp.arange(2 + len(self.blocks))
        return State(
            data=data,
            obs=observations.observe(self._kind, seen, parts=self._parts, targets=self.num_targets),
            objects=self._objects(data),
            moved=block == jnp.where(data.placed < 0, -1, 2 + data.placed),
            reward=rewards.reward(self._reward, progress),
            done=jnp.zeros(()),
            metrics={
                "score": score,
                "success": (score > 0.999).astype(jnp.float32),
                "varied": data.varied,
                "unplaced": data.unplaced.astype(jnp.float32),
            },
        )

    def _objects(self, data: PlanarData) -> Objects:
        blocks, robot = data.pose[self._parts :], data.pose[0]
        shapes = block_shapes.blocks(data.shape)
        low, high = block_shapes.extents(shapes, blocks[:, 2])
        # A disc's fingers are thin: a detector's box is that of the disc.
        part = self.robot.parts[0]
        size = jnp.full(2, 2 * part.radius)
        if not part.radius:
            c, s = jnp.abs(jnp.cos(robot[2])), jnp.abs(jnp.sin(robot[2]))
            half = part.boxes[0].half
            size = 2 * jnp.stack([c * half[0] + s * half[1], s * half[0] + c * half[1]])
        return Objects(
            center=jnp.concatenate([data.goal[None, :2], robot[None, :2], blocks[:, :2]]),
            size=jnp.concatenate([data.goal[None, 2:], size[None], high - low]),
            label=jnp.concatenate(
                [jnp.arange(2), 2 + len(SHAPES) * data.colour + data.shape]
            ).astype(jnp.int32),
            is_robot=jnp.arange(2 + len(self.blocks)) == 1,
        )

    def render(self, data: PlanarData, *, size: int = 384, antialias: bool = False) -> Array:
        """The scene as an image (size, size, 3) of uint8, inside jit; see `raster`."""
        drawn = raster.Scene(data.pose, data.shape, data.colour, data.goal, data.colour[0])
        return raster.render(
            drawn, size=size, half_extent=self.half_extent, antialias=antialias,
            robot=self.robot.name, arena=self.arena,
        )  # fmt: skip

    def outlines(self, data: PlanarData) -> list[Outline]:
        """What to paint for one moment (host side)."""
        data = jax.tree.map(np.asarray, data)
        names = [(COLOURS[c], SHAPES[s]) for c, s in zip(data.colour, data.shape, strict=True)]
        pose = data.pose.astype(np.float64)
        return scene.outlines(self.robot, names, self.arena, pose, data.goal.astype(np.float64))


def _distances(points: Float[Array, "K C"], center: Float[Array, "2"]) -> Float[Array, "K"]:
    return jnp.sqrt(jnp.sum((points[:, :2] - center) ** 2, axis=1) + 1e-12)


def _check(what: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        close = difflib.get_close_matches(str(value), known, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise ValueError(f"{what} is {value!r}, but must be one of {', '.join(known)}{hint}")


def _check_mjx(robot: str, physics: str, variant: str) -> None:
    """Refuse what the engine "mjx" does not serve."""
    if robot != "gripper":
        raise ValueError(f"engine 'mjx' serves the robot 'gripper' only, not {robot!r}")
    if physics != "xmagical":
        raise ValueError(f"engine 'mjx' serves the physics 'xmagical' only, not {physics!r}")
    if variant in ("shape", "all"):
        raise ValueError(f"engine 'mjx' has fixed shapes and cannot serve the variant {variant!r}")
