"""MatchRegions: put the green blocks, and only them, into the green region (MAGICAL's task).

A square arena |x|, |y| <= 1.1 seen from above; a robot drives, turns and, if it has fingers, grips;
blocks slide on the table and stop at once when nothing pushes them. Control runs at 8 Hz.

Action (3,), or (2,) for a stick, each in [-1, 1]:
  0  forward speed, clipped to +-0.8 units/s
  1  turn. "original": x-magical's law, bang-bang beyond 0.0625; "smooth": linear to +-2.5 rad/s
  2  grip: the fingers aim at clip(pi/8 - a, 0, pi/8) rad; 0 or less opens them, 0.393 closes them
Observation: see `observation`; the task's `observation_names` name each number.
Objects: region, robot, targets, distractors, in that order.
Score, success (score 1) and the dense rewards: see `score`.
Physics and engines: see `magical.simulator`. With the physics "magical" an action is rounded to
MAGICAL's 18: forward 0.8, stop, or reverse 0.6; left, none or right; open or closed.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Outline, State
from gril_jax.envs.checks import check_counts, check_known, check_shares
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical import raster, scene, simulator
from gril_jax.envs.magical.layout import CLASSES, COLOURS, RADII, VARIANTS
from gril_jax.envs.planar import robots
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.joints import Command, Strengths
from gril_jax.envs.planar.shapes import SHAPES
from jaxtyping import Array, Float, PRNGKeyArray

from . import observation as observations
from . import score as rewards
from . import start as starts
from . import state as states
from .state import PlanarData

TARGETS = ("green star", "green square")
DISTRACTORS = ("blue pentagon", "yellow circle", "yellow pentagon")


class MatchRegions:
    """The MatchRegions task; see the module docstring for actions, observations and rewards.

    Args:
      robot: "gripper", or a stick: "short", "medium" or "long".
      physics: the preset, "xmagical" or "magical".
      engine: "kernel", "impulse" (the same in JAX, with gradients), "mjx", or "auto": the kernel
        where it runs, else impulse.
      targets, distractors: block names, "<colour> <shape>", such as "green star".
      variant: what is drawn at reset: nothing ("demo"), a little of everything ("jitter",
        +-0.0275 and +-9 degrees), places ("layout"), colours ("color"), shapes ("shape"), forces
        ("dynamics"), or the last four together ("all").
      varied_starts: share of episodes that begin with the robot anywhere, and of those two in three
        with one target already in the region. For training; 0 is the task itself.
      on_the_way: in those, how likely a target that is not in the region is on its way there.
      facing: in those, how likely the robot stands before such a target and faces it.
      turn: "original" or "smooth"; see above.
      observation: "plain", "rich", "sorted" or "xmagical"; see `observation`.
      reward: the task's own reward: "S4", "V5", "S3" or "sparse".
      substeps: physics steps a control step; the original's is 10. None is the engine's own
        choice: 10, or 5 with "mjx".
      iterations: sweeps of the solver a substep; the original's is 10. None: 6, or 2 with "mjx".
    """

    classes = CLASSES
    background = scene.BACKGROUND
    control_hz = simulator.CONTROL_HZ

    def __init__(
        self,
        *,
        robot: str = "gripper",
        physics: str = "xmagical",
        engine: str = "auto",
        targets: tuple[str, ...] = TARGETS,
        distractors: tuple[str, ...] = DISTRACTORS,
        variant: str = "demo",
        varied_starts: float = 0.0,
        on_the_way: float = 0.0,
        facing: float = 0.0,
        turn: str = "original",
        observation: str = "rich",
        reward: str = "S4",
        episode_length: int = 120,
        substeps: int | None = None,
        iterations: int | None = None,
    ):
        check_known("variant", variant, VARIANTS)
        check_known("turn", turn, [*simulator.TURN_GAIN])
        check_known("observation", observation, observations.OBSERVATIONS)
        check_known("reward", reward, rewards.REWARDS)
        check_shares(varied_starts=varied_starts, on_the_way=on_the_way, facing=facing)
        check_counts(episode_length=episode_length)
        self.blocks = (*targets, *distractors)
        _check_blocks(targets, self.blocks, variant)
        split = [name.split() for name in self.blocks]
        self._colour = np.array([COLOURS.index(c) for c, _ in split], np.int32)
        self._shape = np.array([SHAPES.index(s) for _, s in split], np.int32)
        self.engine = simulator.resolved(engine)
        self._engine = simulator.engine(
            self.engine, robot, physics, variant, tuple(self._shape.tolist()), substeps=substeps,
            iterations=iterations,
        )  # fmt: skip
        self._rest = np.asarray(self._engine.rest())
        self.num_targets, self.variant = len(targets), variant
        self.varied_starts, self.on_the_way, self.facing = varied_starts, on_the_way, facing
        self.episode_length = episode_length
        self.turn_gain = simulator.TURN_GAIN[turn]
        self.robot, self.physics = robots.robot(robot), physics
        self.action_size = 3 if self.robot.has_fingers else 2
        self._preset = simulator.PRESETS[physics]
        self.arena, self.half_extent = self._preset.arena, 1.02 * self._preset.arena
        self.stages = rewards.stages(targets, distractors, arena=self.arena)
        self._reward, self._kind = reward, observation
        self._parts = len(self.robot.parts)
        self.observation_names = observations.names(
            observation, self.blocks, fingers=self.robot.has_fingers, targets=len(targets)
        )
        self.observation_size = len(self.observation_names)
        self.action_names = ("forward speed", "turn", "grip")[: self.action_size]

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts a new episode of the task's variant."""
        keys = jax.random.split(key, 6)
        shape, colour = jnp.asarray(self._shape), jnp.asarray(self._colour)
        if self.variant in ("shape", "all"):
            shape = layouts.shapes(keys[0], len(shape))
        if self.variant in ("color", "all"):
            colour = layouts.colours(keys[1], colour, self.num_targets)
        strengths = layouts.strengths(
            keys[2], self._preset, vary=self.variant in ("dynamics", "all")
        )
        radii = jnp.asarray(RADII)[shape]
        within = dict(robot=self.robot, radii=radii, arena=self.arena)
        layout = starts.places(keys[3], self.variant, self.blocks, **within)
        start = states.distances(layout.blocks[: self.num_targets], layout.goal[:2])
        layout, vary, moved = starts.varied(
            keys[4:], layout, share=self.varied_starts, on_the_way=self.on_the_way,
            facing=self.facing, targets=self.num_targets, **within,
        )  # fmt: skip
        pose = jnp.concatenate([layouts.robot_pose(self.robot, layout.robot), layout.blocks])
        nearest = states.distances(layout.blocks[: self.num_targets], layout.robot[:2])
        data = PlanarData(
            pose, jnp.zeros_like(pose), jnp.asarray(self._rest), shape, colour,
            jnp.stack(strengths), layout.goal, start, nearest, layout.unplaced,
            vary.astype(jnp.float32), moved,
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
        """The state with given poses (x, y, angle) and their rates, in the order of `PlanarData`.

        Args:
          goal: centre x, y, width, height of the region; None is the Demo layout's.
          start: where the targets were at reset, which S4 counts from; None is where they are.
          action: what brought the scene here. The solver then starts with the impulses that it
            would have given; None starts with none, as after a reset.
        """
        goal = jnp.array(starts.DEMO_GOAL) if goal is None else goal
        targets, shape = self._targets(pose), jnp.asarray(self._shape)
        strengths = Strengths(*(jnp.float32(s) for s in self._preset.strengths))
        memory = jnp.asarray(self._rest)
        if action is not None:
            command = self._command(action)
            memory = self._engine.settle(
                pose, velocity, block_shapes.blocks(shape), strengths, command
            )
        start = states.distances(targets if start is None else start, goal[:2])
        data = PlanarData(
            pose, velocity, memory, shape, jnp.asarray(self._colour),
            jnp.stack(strengths), goal, start, states.distances(targets, pose[0, :2]),
            jnp.zeros((), bool), jnp.zeros(()), jnp.zeros(len(self.blocks), bool),
        )  # fmt: skip
        return self._observe(data)

    def place(
        self, center: Float[Array, "N 2"], size: Float[Array, "N 2"], key: PRNGKeyArray
    ) -> State:
        """A start with everything where its box lies, in the order of `objects`, and at rest.

        Boxes do not show angles, which are drawn; a robot that could not stand there at those
        drawn, as one that holds a block, stands as near as it can. S4 counts from a start of the
        task, as it would had the episode begun there. For variants with the blocks' own shapes and
        colours.
        """
        key_robot, key_angle, key_there, key_start = jax.random.split(key, 4)
        radii = jnp.asarray(RADII)[jnp.asarray(self._shape)]
        angle = jax.random.uniform(key_angle, (len(radii), 1), minval=-jnp.pi, maxval=jnp.pi)
        blocks = jnp.concatenate([center[2:], angle], axis=1)
        scene = self.robot, blocks, radii, None
        there, taken = layouts.place_robot(key_there, *scene, arena=self.arena, at=center[1])
        elsewhere, _ = layouts.place_robot(key_robot, *scene, arena=self.arena)
        robot = layouts.robot_pose(self.robot, jnp.where(taken, elsewhere, there))
        pose, still = jnp.concatenate([robot, blocks]), jnp.zeros((len(blocks) + self._parts, 3))
        begun = starts.places(
            key_start, self.variant, self.blocks, robot=self.robot, radii=radii, arena=self.arena
        )
        start, goal = begun.blocks[: self.num_targets, :2], jnp.concatenate([center[0], size[0]])
        return self.reset_to(pose, still, goal=goal, start=start)

    def clearance(self, pose: Float[Array, "E 3"]) -> Float[Array, ""]:
        """Gap between the robot and the nearest block or wall, for the task's own shapes."""
        return self._engine.clearance(pose, block_shapes.blocks(jnp.asarray(self._shape)))

    def step(self, state: State, action: Float[Array, "A"]) -> State:
        """Advances one control step: 1/8 s under a held action."""
        data = state.data
        # Shapes that never change are constants of the compiled program.
        shape = data.shape if self.variant in ("shape", "all") else jnp.asarray(self._shape)
        pose, velocity, memory = self._engine.step(
            data.pose, data.velocity, data.memory, block_shapes.blocks(shape),
            Strengths(*data.strengths), self._command(action),
        )  # fmt: skip
        nearest = jnp.minimum(data.nearest, states.distances(self._targets(pose), pose[0, :2]))
        changed = dict(pose=pose, velocity=velocity, memory=memory, nearest=nearest)
        return self._observe(data._replace(**changed))

    def _targets(self, pose: Float[Array, "E 3"]) -> Float[Array, "K 3"]:
        return pose[self._parts : self._parts + self.num_targets]

    def _command(self, action: Float[Array, "A"]) -> Command:
        return simulator.commanded(
            action, physics=self.physics, gain=self.turn_gain, dt=self._engine.dt
        )

    def _observe(self, data: PlanarData) -> State:
        progress = states.progress(data, parts=self._parts, targets=self.num_targets)
        score = rewards.score(progress)
        seen = observations.Observed(data.pose, data.velocity, data.goal, progress.inside)
        return State(
            data=data,
            obs=observations.observe(self._kind, seen, parts=self._parts, targets=self.num_targets),
            objects=states.objects(data, self.robot),
            moved=jnp.concatenate([jnp.zeros(2, bool), data.moved]),
            reward=rewards.reward(self._reward, progress),
            done=jnp.zeros(()),
            metrics={
                "score": score,
                "success": (score > 0.999).astype(jnp.float32),
                "varied": data.varied,
                "unplaced": data.unplaced.astype(jnp.float32),
            },
        )

    def render(self, data: PlanarData, *, size: int = 384, antialias: bool = False) -> Array:
        """The scene as an image (size, size, 3) of uint8, inside jit; see `raster`."""
        drawn = raster.Painting(data.pose, data.shape, data.colour, data.goal, data.colour[0])
        return raster.render(
            drawn, size=size, half_extent=self.half_extent, antialias=antialias,
            robot=self.robot.name, arena=self.arena,
        )  # fmt: skip

    def outlines(self, data: PlanarData) -> list[Outline]:
        """The outlines of one moment, to be painted (host side)."""
        data = jax.tree.map(np.asarray, data)
        names = [(COLOURS[c], SHAPES[s]) for c, s in zip(data.colour, data.shape, strict=True)]
        pose, goal = (f.astype(np.float64) for f in (data.pose, data.goal))
        return scene.outlines(self.robot, names, self.arena, pose, [(names[0][0], goal)])


def _check_blocks(targets: tuple[str, ...], blocks: tuple[str, ...], variant: str) -> None:
    """Raises ValueError without a target, or for a block that the variant cannot place."""
    if not targets:
        raise ValueError("targets is empty, but needs at least one block")
    for name in blocks:
        check_known("block", name, CLASSES[2:])
        if variant not in ("layout", "all") and name not in starts.DEMO_BLOCKS:
            raise ValueError(f"block {name!r} has no place in the {variant} layout")
