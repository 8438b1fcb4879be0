"""MatchRegions: put the green blocks, and only them, into the green region (MAGICAL's task).

A member of the suite (`suite.task`: actions, simulator, pictures), as x-magical has it: an arena
|x|, |y| <= 1.1, in which blocks stop at once when nothing pushes them, and scenes of given blocks.
Objects: region, robot, targets, distractors, in that order.
"""

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Objects, State
from gril_jax.envs.checks import check_known, check_shares
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical import scene as looks
from gril_jax.envs.magical.layout import CLASSES, RADII, VARIANTS
from gril_jax.envs.magical.suite import state
from gril_jax.envs.magical.suite.plan import Scene, in_region, shapes
from gril_jax.envs.magical.suite.state import SuiteData
from gril_jax.envs.magical.suite.task import SuiteTask
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.joints import Strengths
from gril_jax.envs.stages import Stages
from jaxtyping import Array, Float, PRNGKeyArray

from . import observation as observations
from . import score as rewards
from . import start as starts
from .score import Progress

TARGETS = ("green star", "green square")
DISTRACTORS = ("blue pentagon", "yellow circle", "yellow pentagon")


_OBJECTS = "objects"
_LONG_STICK = 60  # control steps of an episode, as the original registers it


class MatchRegions(SuiteTask):
    """The MatchRegions task; see the module docstring, and `SuiteTask` for what is not below.

    Args:
      targets, distractors: block names, "<colour> <shape>", such as "green star".
      variant: what is sampled at reset: nothing ("demo"), a little of everything ("jitter",
        +-0.0275 and +-9 degrees), places ("layout"), colours ("color"), shapes ("shape"), forces
        ("dynamics"), or the last four together ("all").
      varied_starts: share of episodes that begin with the robot anywhere, and of those two in three
        with one target already in the region. For training; 0 is the task itself.
      on_the_way: in those, how likely a target that is not in the region is on its way there.
      facing: in those, how likely the robot stands before such a target and faces it.
      observation: "plain", "rich", "sorted" or "xmagical", see `observation`; or "objects", that of
        the suite's other tasks, in the order of the objects.
      reward: the task's own reward: "S4", "V5" or "sparse".
      substeps, iterations: as of `SuiteTask`; None is with "mjx" 5 and 2.
    """

    classes = CLASSES
    length = 120
    variants, rewards, roles = VARIANTS, rewards.REWARDS, ()
    shifted = None  # its objects come in another order than those of the suite
    look = looks.X_MAGICAL

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
        observation: str = "rich",
        reward: str = "S4",
        episode_length: int | None = None,
        substeps: int | None = None,
        iterations: int | None = None,
    ):
        check_known("observation", observation, (*observations.OBSERVATIONS, _OBJECTS))
        check_shares(varied_starts=varied_starts, on_the_way=on_the_way, facing=facing)
        self.blocks, self.num_targets = (*targets, *distractors), len(targets)
        _check_blocks(targets, self.blocks, variant)
        self.plan, self._kind = starts.plan(self.blocks), observation
        self.varied_starts, self.on_the_way, self.facing = varied_starts, on_the_way, facing
        if episode_length is None and robot == "long":
            episode_length = _LONG_STICK
        super().__init__(
            robot=robot, physics=physics, engine=engine, variant=variant, reward=reward,
            episode_length=episode_length, substeps=substeps, iterations=iterations,
        )  # fmt: skip
        if self.varies("color") or self.varies("shape"):
            self.place = None  # it knows the blocks' own colours and shapes alone

    @property
    def object_names(self) -> tuple[str, ...]:
        """The objects in the order of `objects`."""
        return ("goal", "robot", *self.blocks)

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts a new episode of the task's variant."""
        keys, kinds = jax.random.split(key, 6), jax.tree.map(jnp.asarray, self._kinds)
        if self.varies("shape"):
            kinds = kinds._replace(shape=shapes(keys[0], len(kinds.shape)))
        if self.varies("color"):
            colour = layouts.colours(keys[1], kinds.colour, self.num_targets)
            kinds = kinds._replace(colour=colour, region_colour=colour[:1])
        strengths = layouts.strengths(keys[2], self._preset, vary=self.varies("dynamics"))
        radii = jnp.asarray(RADII)[kinds.shape]
        within = dict(robot=self.robot, radii=radii, arena=self.arena)
        at = starts.places(keys[3], self.variant, self.plan, **within)
        start = self._distances(at.blocks, at.regions[0, :2])
        at, vary, moved = starts.varied(
            keys[4:], at, share=self.varied_starts, on_the_way=self.on_the_way,
            facing=self.facing, targets=self.num_targets, **within,
        )  # fmt: skip
        nearest = self._distances(at.blocks, at.robot[:2])
        progress = Progress(start, nearest, vary.astype(jnp.float32), moved)
        return self._begun(kinds, at, strengths, progress)

    def reset_to(
        self,
        pose: Float[Array, "E 3"],
        velocity: Float[Array, "E 3"],
        *,
        goal: Float[Array, "4"] | None = None,
        start: Float[Array, "K 2"] | None = None,
        action: Float[Array, "A"] | None = None,
    ) -> State:
        """The state with given poses (x, y, angle) and their rates, in the order of `SuiteData`.

        Args:
          goal: centre x, y, width, height of the region; None is the Demo layout's.
          start: where the targets were at reset, which S4 counts from; None is where they are.
          action: what brought the scene here. The solver then starts with the impulses that it
            would have given; None starts with none, as after a reset.
        """
        goal = jnp.array(self.plan.regions[0].box()) if goal is None else goal
        kinds, blocks = jax.tree.map(jnp.asarray, self._kinds), pose[self._parts :]
        strengths = Strengths(*(jnp.float32(s) for s in self._preset.strengths))
        memory = jnp.asarray(self._rest)
        if action is not None:
            scene = pose, velocity, block_shapes.blocks(kinds.shape), strengths
            memory = self._engine.settle(*scene, self._command(action))
        progress = Progress(
            self._distances(blocks if start is None else start, goal[:2]),
            self._distances(blocks, pose[0, :2]), jnp.zeros(()), jnp.zeros(len(blocks), bool),
        )  # fmt: skip
        return self._observe(SuiteData(
            pose, velocity, memory, kinds.shape, kinds.colour, goal[None], kinds.region_colour,
            jnp.stack(strengths), jnp.zeros((), bool), progress,
        ))  # fmt: skip

    def place(
        self, center: Float[Array, "N 2"], size: Float[Array, "N 2"], key: PRNGKeyArray
    ) -> State:
        """A start with everything where its box lies, in the order of `objects`, and at rest.

        Boxes do not show angles and forces, which are sampled; a robot that could not stand there
        at those sampled, as one that holds a block, stands as near as it can. S4 counts from a
        start of the task, as it would had the episode begun there. For variants with the blocks'
        own shapes and colours.
        """
        key_robot, key_angle, key_there, key_start = jax.random.split(key, 4)
        radii = jnp.asarray(RADII)[jnp.asarray(self._kinds.shape)]
        within = dict(robot=self.robot, radii=radii, arena=self.arena)
        angle = jax.random.uniform(key_angle, (len(radii), 1), minval=-jnp.pi, maxval=jnp.pi)
        blocks = jnp.concatenate([center[2:], angle], axis=1)
        robot = layouts.stand((key_there, key_robot), blocks=blocks, at=center[1], **within)
        robot = layouts.robot_pose(self.robot, robot)
        pose, still = jnp.concatenate([robot, blocks]), jnp.zeros((len(blocks) + self._parts, 3))
        begun = starts.places(key_start, self.variant, self.plan, **within)
        start, goal = begun.blocks[: self.num_targets, :2], jnp.concatenate([center[0], size[0]])
        made = self.reset_to(pose, still, goal=goal, start=start)
        if not self.varies("dynamics"):
            return made
        key_forces = jax.random.fold_in(key, 4)
        strengths = layouts.strengths(key_forces, self._preset, vary=True)
        return self._observe(made.data._replace(strengths=jnp.stack(strengths)))

    def clearance(self, pose: Float[Array, "E 3"]) -> Float[Array, ""]:
        """Gap between the robot and the nearest block or wall, for the task's own shapes."""
        return self._engine.clearance(pose, block_shapes.blocks(jnp.asarray(self._kinds.shape)))

    # ------------------------------------------------------------ where it differs from the suite

    def score(self, scene: Scene) -> Float[Array, ""]:
        """The score of `score.score`."""
        return rewards.score(rewards.inputs(scene, self.num_targets))

    def reward(self, scene: Scene) -> Float[Array, ""]:
        """The reward of the name that was chosen."""
        return rewards.reward(self._reward, rewards.inputs(scene, self.num_targets))

    def _stages(self) -> Stages:
        return rewards.stages(self.blocks, self.num_targets, arena=self.arena)

    def _distances(self, blocks: Float[Array, "B C"], to: Float[Array, "2"]) -> Float[Array, "K"]:
        """Distances of the targets from a point."""
        return rewards.distances(blocks[: self.num_targets], to)

    def _advanced(self, progress: Progress, pose: Float[Array, "E 3"]) -> Progress:
        away = self._distances(pose[self._parts :], pose[0, :2])
        return progress._replace(nearest=jnp.minimum(progress.nearest, away))

    @property
    def observation_rows(self) -> tuple[tuple[int, int], ...] | None:
        """Number and length of the rows of "objects"; other observations have none."""
        return super().observation_rows if self._kind == _OBJECTS else None

    def _names(self) -> tuple[str, ...]:
        if self._kind == _OBJECTS:
            return super()._names()
        return observations.names(
            self._kind, self.blocks, fingers=self.robot.has_fingers, targets=self.num_targets
        )

    def _seen(self, data: SuiteData) -> Float[Array, "O"]:
        if self._kind == _OBJECTS:  # in the order of `objects`
            as_listed = state.Order(np.arange(1), np.arange(len(self.blocks)))
            return state.observe(data, self._parts, as_listed)
        region = data.regions[0]
        inside = in_region(region, data.pose[self._parts :, :2])
        seen = observations.Observed(data.pose, data.velocity, region, inside)
        return observations.observe(self._kind, seen, parts=self._parts, targets=self.num_targets)

    def _objects(self, data: SuiteData) -> Objects:
        return rewards.objects(data, self.robot)

    def _observe(self, data: SuiteData) -> State:
        state, progress = super()._observe(data), data.progress
        moved = jnp.concatenate([jnp.zeros(2, bool), progress.moved])
        return state._replace(moved=moved, metrics={**state.metrics, "varied": progress.varied})


def _check_blocks(targets: tuple[str, ...], blocks: tuple[str, ...], variant: str) -> None:
    """Raises ValueError without a target, or for a block that the variant cannot place."""
    if not targets:
        raise ValueError("targets is empty, but needs at least one block")
    for name in blocks:
        check_known("block", name, CLASSES[2:])
        if variant not in ("layout", "all") and name not in starts.DEMO_BLOCKS:
            raise ValueError(f"block {name!r} has no place in the {variant} layout")
        if variant not in ("layout", "all") and blocks.count(name) > 1:
            raise ValueError(
                f"block {name!r} is named twice, but has one place in the {variant} layout"
            )
