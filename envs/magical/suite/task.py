"""The base of MAGICAL's tasks: starts, steps, observations, and a score of the last state.

A square arena is seen from above; a robot drives, turns and, if it has fingers, grips; control runs
at 8 Hz. The original has no reward but the score of the last state: here every state has its score,
which is the reward, and success is score 1.

Action (3,), or (2,) for a stick, each in [-1, 1]:
  0  forward speed, clipped to +-0.8 units/s
  1  turn, x-magical's law: bang-bang beyond 0.0625
  2  grip: the fingers aim at clip(pi/8 - a, 0, pi/8) rad; 0 or less opens them, 0.393 closes them
With the physics "magical" an action is rounded to MAGICAL's 18: forward 0.8, stop, or reverse 0.6;
left, none or right; open or closed.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Objects, Outline, State
from gril_jax.envs.checks import check_counts, check_known
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical import scene as looks
from gril_jax.envs.magical import simulator
from gril_jax.envs.magical.layout import Places
from gril_jax.envs.planar import robots
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.joints import Command, Strengths
from gril_jax.envs.planar.shapes import NOTHING
from gril_jax.envs.stages import Stage, Stages, free_place
from jaxtyping import Array, Float, PRNGKeyArray

from . import places, state
from .plan import CLASSES, VARIANTS, Kinds, Plan, Scene, outside
from .state import SuiteData

Holds = Callable[[Array, Array], Array]  # (centres, sizes) -> True if a stage is done
Place = Callable[[PRNGKeyArray, Array, Array], Array]  # (key, centres, sizes) -> centres


class SuiteTask:
    """One of MAGICAL's tasks; see the module docstring.

    Args:
      robot: "gripper", or a stick: "short", "medium" or "long".
      physics: the preset, "magical" or "xmagical".
      engine: "kernel", "impulse" (the same in JAX, with gradients), "mjx", or "auto": the kernel
        where it runs, else impulse.
      variant: what reset samples: nothing ("demo"), a little of everything ("jitter"), colours
        ("color"), "shape", places ("layout"), these three and the number of blocks ("countplus"),
        forces ("dynamics"), or all of it ("all"); those that MAGICAL has for the task.
      reward: the task's own reward; "sparse" is the score of each state.
      episode_length: control steps; None is the original's number.
      substeps: physics steps a control step; the original's is 10, as None is.
      iterations: sweeps of the solver a substep; the original's is 10. None: 6.
      padded: every variant has room for as many blocks as any has, so that observations are of one
        size; those that are not there have zeros in it, and boxes without a size.
    """

    classes = CLASSES
    background = looks.BACKGROUND
    control_hz = simulator.CONTROL_HZ
    plan: Plan
    length: int  # of an episode, in control steps
    variants: tuple[str, ...] = VARIANTS
    near: tuple[str, ...] = ("jitter",)  # variants with places near those of Demo
    anywhere: tuple[str, ...] = ("layout", "countplus", "all")
    rewards: tuple[str, ...] = ("sparse",)
    roles = ("color", "shape", "count")  # what a variant draws that its stages do not know
    look = looks.ORIGINAL  # how pictures paint floor and regions
    robot_first = False  # painted below the blocks

    def __init__(
        self,
        *,
        robot: str = "gripper",
        physics: str = "magical",
        engine: str = "auto",
        variant: str = "demo",
        reward: str = "sparse",
        episode_length: int | None = None,
        substeps: int | None = None,
        iterations: int | None = None,
        padded: bool = False,
    ):
        check_known("variant", variant, self.variants)
        check_known("reward", reward, self.rewards)
        self.variant = variant
        self.episode_length = self.length if episode_length is None else episode_length
        check_counts(episode_length=self.episode_length)
        slots = self.plan.slots if padded or self.varies("count") else None
        self._missing = max(0, (slots or 0) - len(self.plan.blocks))
        self._kinds = self._filled(self.plan.kinds(), np)
        # An engine has at least one block; where the task has none, it is not there.
        self._spare = 0 if len(self._kinds.shape) else 1
        moving = (*self._kinds.shape.tolist(), *[NOTHING] * self._spare)
        self.engine = simulator.resolved(engine)
        self._engine = simulator.engine(
            self.engine, robot, physics, variant, moving, substeps=substeps, iterations=iterations
        )
        self._rest = np.asarray(self._engine.rest())
        self.robot, self.physics = robots.robot(robot), physics
        self._preset = simulator.PRESETS[physics]
        self.arena, self.half_extent = self._preset.arena, 1.02 * self._preset.arena
        self._reward, self._parts = reward, len(self.robot.parts)
        self._order = state.order(self.plan, self._kinds)
        self.observation_names = self._names()
        self.observation_size = len(self.observation_names)
        self.action_size = 3 if self.robot.has_fingers else 2
        self.action_names = ("forward speed", "turn", "grip")[: self.action_size]
        self.stages = self._stages()

    # ------------------------------------------------------------ what tasks differ in

    def draw(self, keys: Callable[[], PRNGKeyArray], kinds: Kinds) -> Kinds:
        """The kinds of a start: those of Demo, but for what the variant draws."""
        return kinds

    def score(self, scene: Scene) -> Float[Array, ""]:
        """The original's score of a state, from 0 to 1."""
        raise NotImplementedError

    def _stages(self) -> Stages:
        """The stages of the Demo start's objects."""
        raise NotImplementedError

    def reward(self, scene: Scene) -> Float[Array, ""]:
        """The reward of the name that was chosen."""
        return self.score(scene)

    def _advanced(self, progress: Any, pose: Float[Array, "E 3"]) -> Any:
        """The task's memory of the episode, a control step later."""
        return progress

    def _names(self) -> tuple[str, ...]:
        """A name for each number of the observation."""
        count = len(self.plan.regions), len(self._kinds.shape)
        return state.names(*count, fingers=self.robot.has_fingers)

    def _seen(self, data: SuiteData) -> Float[Array, "O"]:
        """The observation."""
        return state.observe(data, self._parts, self._order)

    def _objects(self, data: SuiteData) -> Objects:
        """The objects as a detector would report them."""
        return state.objects(data, self.robot, self._order)

    @property
    def observation_rows(self) -> tuple[tuple[int, int], ...] | None:
        """Number and length of the rows that end the observation, by `state.rows`; None: it has no
        such rows."""
        return state.rows(len(self.plan.regions), len(self._kinds.shape))

    @property
    def object_names(self) -> tuple[str, ...]:
        """The objects of the Demo start, in the order of `objects`."""
        return (
            "robot",
            *(f"{self.plan.regions[r].colour} region" for r in self._order.regions),
            *(self.plan.blocks[b].name for b in self._order.blocks if b < len(self.plan.blocks)),
        )

    # ------------------------------------------------------------ the contract

    @property
    def stages_hold(self) -> bool:
        """True if `stages`, which know Demo's blocks, say what a success is in this variant."""
        return not any(map(self.varies, self.roles))

    def varies(self, what: str) -> bool:
        """True if the variant draws this: "color", "shape", "count" or "dynamics"."""
        with_counts = self.variant in ("countplus", "all")
        if what == "count":
            return with_counts and "countplus" in self.variants
        if what == "dynamics":
            return self.variant in ("dynamics", "all")
        return self.variant == what or (with_counts and what in self.variants)

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts a new episode of the task's variant."""
        key_kinds, key_places, key_forces = jax.random.split(key, 3)
        counted = self.varies("count")  # else what is missing is not drawn
        kinds = self.draw(_stream(key_kinds), self._kinds if counted else self.plan.kinds())
        kinds = jax.tree.map(jnp.asarray, kinds)
        kinds = kinds if counted else self._filled(kinds, jnp)
        start = places.demo(self.plan, len(kinds.shape))
        if self.variant in (*self.near, *self.anywhere):
            start = places.draw(
                key_places, self.plan, kinds, self.robot, arena=self.arena,
                anywhere=self.variant in self.anywhere,
            )  # fmt: skip
        strengths = layouts.strengths(key_forces, self._preset, vary=self.varies("dynamics"))
        return self._begun(kinds, start, strengths)

    def place(
        self, center: Float[Array, "N 2"], size: Float[Array, "N 2"], key: PRNGKeyArray
    ) -> State:
        """A start with everything where its box lies, in the order of `objects`, and at rest.

        What boxes do not show is sampled. In variants with random colours or shapes, each is
        replaced by another one. Where a variant puts things anywhere, the whole scene is turned and
        moved; see `from_boxes`.
        """
        key_kinds, key_move, key_place, key_forces = jax.random.split(key, 4)
        kinds, listed = jax.tree.map(jnp.asarray, self._kinds), self._order
        boxes = jnp.concatenate([center, size], axis=1)
        if self.variant in self.anywhere:
            standing = kinds.shape[listed.blocks] != NOTHING
            present = jnp.append(jnp.ones(1 + len(listed.regions), bool), standing)
            boxes = places.moved(key_move, boxes, present, arena=self.arena)
        kinds = places.renamed(
            key_kinds, kinds, colours=self.varies("color"), shapes=self.varies("shape")
        )
        found = places.placed(key_place, boxes, kinds, listed, self.robot, arena=self.arena)
        strengths = layouts.strengths(key_forces, self._preset, vary=self.varies("dynamics"))
        return self._begun(kinds, found, strengths)

    def shifted(self, state: State, center: Float[Array, "N 2"]) -> State:
        """The same state with robot and blocks moved to these centres, in the order of `objects`;
        angles and speeds stay as they are."""
        data, listed = state.data, self._order
        count = len(data.shape)
        pose = data.pose.at[: self._parts, :2].add(center[0] - data.pose[0, :2])
        blocks = jnp.zeros((count, 2)).at[listed.blocks].set(center[1 + len(listed.regions) :])
        pose = pose.at[self._parts : self._parts + count, :2].set(blocks)
        return self._observe(data._replace(pose=pose))

    def step(self, state: State, action: Float[Array, "A"]) -> State:
        """Advances one control step: 1/8 s under a held action."""
        data = state.data
        # Shapes that never change are constants of the compiled program.
        fixed = not (self.varies("shape") or self.varies("count"))
        shape = jnp.asarray(self._kinds.shape) if fixed else data.shape
        shape = jnp.concatenate([shape, jnp.full(self._spare, NOTHING, jnp.int32)])
        pose, velocity, memory = self._engine.step(
            data.pose, data.velocity, data.memory, block_shapes.blocks(shape),
            Strengths(*data.strengths), self._command(action),
        )  # fmt: skip
        changed = dict(pose=pose, velocity=velocity, memory=memory)
        progress = self._advanced(data.progress, pose)
        return self._observe(data._replace(**changed, progress=progress))

    def _command(self, action: Float[Array, "A"]) -> Command:
        return simulator.commanded(action, physics=self.physics, dt=self._engine.dt)

    def outlines(self, data: SuiteData) -> list[Outline]:
        """The outlines of one state, to be painted (host side)."""
        look = dict(arena=self.arena, look=self.look, robot_first=self.robot_first)
        return state.outlines(data, self.robot, **look)

    def render(self, data: SuiteData, *, size: int = 384, antialias: bool = False) -> Array:
        """The scene as an image (size, size, 3) of uint8, inside jit; see `raster`."""
        look = dict(arena=self.arena, look=self.look, robot_first=self.robot_first)
        shown = dict(half_extent=self.half_extent, size=size, antialias=antialias)
        return state.render(data, self.robot, **look, **shown)

    def _staged(
        self, stages: Sequence[Stage], movable: tuple[int, ...], faults: Sequence[Stage] = ()
    ) -> Stages:
        """Stages whose progress is the score; the robot, object 0, moves things."""
        return Stages(
            tuple(stages), movable, self.arena, self.scored, robots=(0,), faults=tuple(faults)
        )

    def _scatter(self, block: int, holds: Holds, others: tuple[int, ...]) -> Place:
        """Puts a block anywhere where a stage holds."""

        def place(key, center, size):
            limit = self.arena - size[block] / 2
            return free_place(
                key, block, center, size, low=-limit, high=limit, others=others,
                allowed=lambda c: holds(c, size),
            )  # fmt: skip

        return place

    def _begun(self, kinds: Kinds, at: Places, strengths: Strengths, progress: Any = ()) -> State:
        """The state with everything at rest."""
        spare = jnp.array([outside(0)] * self._spare).reshape(-1, 3)
        pose = jnp.concatenate([layouts.robot_pose(self.robot, at.robot), at.blocks, spare])
        return self._observe(SuiteData(
            pose, jnp.zeros_like(pose), jnp.asarray(self._rest), kinds.shape, kinds.colour,
            at.regions, kinds.region_colour, jnp.stack(strengths), at.unplaced, progress,
        ))  # fmt: skip

    def _filled(self, kinds: Kinds, xp: Any) -> Kinds:
        """With the slots that the plan does not fill, by NumPy or by JAX."""
        fill = lambda known, value: xp.append(  # noqa: E731
            known, xp.full(self._missing, value, xp.int32)
        )
        return kinds._replace(shape=fill(kinds.shape, NOTHING), colour=fill(kinds.colour, 0))

    def _observe(self, data: SuiteData) -> State:
        scene = state.scene(data, self._parts)
        score = self.score(scene)
        seen = self._objects(data)
        return State(
            data=data,
            obs=self._seen(data),
            objects=seen,
            moved=jnp.zeros(len(seen.label), bool),
            reward=self.reward(scene),
            done=jnp.zeros(()),
            metrics={
                "score": score,
                "success": (score > 0.999).astype(jnp.float32),
                "unplaced": data.unplaced.astype(jnp.float32),
            },
        )

    def scored(self, task: Stages, center: Float[Array, "N 2"], size: Float[Array, "N 2"]):
        """The score of boxes in the order of the objects, for Demo's colours and shapes."""
        kinds, regions = self.plan.kinds(), len(self.plan.regions)
        rows = np.argsort(self._order.blocks[: len(kinds.shape)])
        boxes = jnp.concatenate([center, size], axis=1)[1 : 1 + regions]
        blocks = center[1 + regions :][rows]
        return self.score(Scene(
            center[0], blocks, jnp.asarray(kinds.shape), jnp.asarray(kinds.colour),
            boxes[np.argsort(self._order.regions)], jnp.asarray(kinds.region_colour),
        ))  # fmt: skip


def _stream(key: PRNGKeyArray) -> Callable[[], PRNGKeyArray]:
    """A function that returns another key at each call."""
    count = iter(range(2**31))
    return lambda: jax.random.fold_in(key, next(count))
