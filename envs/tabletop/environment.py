"""A Panda at a table: the environment shared by all tabletop tasks.

Control runs at 20 Hz over physics of 5 ms. The base of the arm is the origin, x points forward,
y to its left, z up, and the table is at z = 0; lengths are metres. What lies on it is a `Task`.
Actions: see `panda.kinematics.aim`. Objects: left finger, right finger, hand, then the task's.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import Objects, Outline, State
from gril_jax.envs.checks import check_counts, check_known, check_shares
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda import model as panda_model
from gril_jax.envs.panda.kinematics import Frame
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import REWARDS, boxes, from_boxes, physics, resting
from . import reward as rewards
from . import task as observations
from .boxes import Boxes
from .physics import Motion, build
from .reward import Record
from .start import Moments, Start, draw_moment
from .task import Task, View

CONTROL_HZ = 20.0
_ROBOT = ("left finger", "right finger", "hand")
_ARM_NOISE = 0.02  # rad, standard deviation at reset (ManiSkill's)
_COLOURS = (
    (90, 90, 96), (90, 90, 96), (60, 60, 66), (176, 120, 70), (206, 158, 104), (58, 96, 176),
    (176, 62, 58), (76, 140, 84), (150, 96, 160),
)  # fmt: skip


class TabletopData(NamedTuple):
    """The memory of an episode."""

    motion: Motion
    target: Float[Array, "8"]  # the servos' aims: joints, opening of a finger
    fixtures: Float[Array, "M 7"]
    action: Float[Array, "A"]  # the last one
    record: Record
    time: Int[Array, ""]  # control steps since reset
    unplaced: Bool[Array, ""]  # the start found no free place
    varied: Bool[Array, ""]  # the episode began at a state of another


def _hand(motion: Motion) -> tuple[Frame, Frame, Frame]:
    """Frames of the hand, the left finger and the right one."""
    hand = kinematics.hand(motion.qpos[:7])
    left, right = motion.qpos[7], motion.qpos[8]
    return hand, kinematics.finger(hand, left, 1), kinematics.finger(hand, right, -1)


class Tabletop:
    """A task on the table; see the module docstring for actions and observations.

    Args:
      task: what is on the table.
      reward: "staged", "stages" or "sparse"; see `reward`.
      observation: "rich" or "plain"; see `observation`.
      jitter: share of the ranges of the start's randomness, from 0 to 1.
      varied_starts: share of the episodes that begin at one of these states:
      moments: states of recorded episodes of the task.
      substeps: physics steps a control step.
      iterations, ls_iterations: of the contact solver and its line search. With 4 and 6 three
        of a thousand episodes of random actions were not finite on a GPU.
      max_contacts: most contacts that a substep resolves; the deepest count. None: the task's.
      impl, worlds: what computes the physics, and for how many environments at most; see
        `physics.Physics`.

    Raises:
      ValueError: a name or a number is out of range, or a package is missing.
    """

    control_hz = CONTROL_HZ
    half_extent = boxes.HALF_EXTENT
    camera = boxes.CAMERA
    background = (236, 236, 232)

    def __init__(
        self,
        task: Task,
        *,
        reward: str = "staged",
        observation: str = "rich",
        jitter: float = 1.0,
        varied_starts: float = 0.0,
        moments: Moments | None = None,
        episode_length: int | None = None,
        substeps: int = 10,
        iterations: int = 6,
        ls_iterations: int = 8,
        max_contacts: int | None = None,
        impl: str = "jax",
        worlds: int = 4096,
    ):
        length = task.episode_length if episode_length is None else episode_length
        max_contacts = task.max_contacts if max_contacts is None else max_contacts
        check_known("reward", reward, REWARDS)
        check_known("observation", observation, observations.OBSERVATIONS)
        check_known("impl", impl, physics.IMPLEMENTATIONS)
        check_shares(jitter=jitter, varied_starts=varied_starts)
        if varied_starts and moments is None:
            raise ValueError(f"varied_starts is {varied_starts}, but no recorded states are given")
        check_counts(
            episode_length=length, substeps=substeps, iterations=iterations,
            ls_iterations=ls_iterations, max_contacts=max_contacts, worlds=worlds,
        )  # fmt: skip
        self.task, self.jitter = task, jitter
        self._varied_starts, self._moments = varied_starts, moments
        self.episode_length, self._reward = length, reward
        self.classes = (*_ROBOT, *task.things)
        self.action_names = kinematics.ACTION_NAMES
        self.action_size = len(self.action_names)
        self.stage_names = task.stages
        self.stages = task.by_boxes(self.classes, half_extent=self.half_extent)
        self._home = np.array(task.home, np.float32)
        model = build(
            task.scene, timestep=1 / (CONTROL_HZ * substeps), iterations=iterations,
            ls_iterations=ls_iterations, max_contacts=max_contacts,
        )  # fmt: skip
        self.physics = physics.Physics(model, substeps=substeps, impl=impl, worlds=worlds)
        self._told = self.stage_names if observation == "rich" else ()
        self.observation_names = observations.names(
            task.things, self._told, self.action_names, rates=model.nv - panda_model.DOFS
        )
        self.observation_size = len(self.observation_names)

    def reset(self, key: PRNGKeyArray) -> State:
        """Starts a new episode."""
        if not self._varied_starts:
            return self._observe(*[self._begin(key)] * 2)
        key, key_varied, key_moment = jax.random.split(key, 3)
        varied = jax.random.uniform(key_varied) < self._varied_starts
        data, moved = self._within(draw_moment(key_moment, self._moments))
        data = jax.tree.map(lambda a, b: jnp.where(varied, a, b), data, self._begin(key))
        return self._observe(data, data)._replace(moved=moved & varied)

    def reset_to(
        self, arm: Float[Array, "7"], start: Start, *, opening: Float[Array, ""] | float
    ) -> State:
        """Starts an episode at rest with given joints, objects, and opening of each finger."""
        return self._observe(*[self._at_rest(arm, start, opening)] * 2)

    def place(
        self, center: Float[Array, "N 2"], size: Float[Array, "N 2"], key: PRNGKeyArray
    ) -> State:
        """A start with the things where these boxes lie, in the order of `objects`.

        The hand is where its boxes are, and holds what it holds there, but higher if it touches
        anything else. See `from_boxes`.
        """
        return self.place_held(center, size, key, jnp.zeros(len(center), bool))

    def place_held(
        self, center: Float[Array, "N 2"], size: Float[Array, "N 2"], key: PRNGKeyArray,
        held: Bool[Array, "N"],
    ) -> State:  # fmt: skip
        """The same, where it is known what the hand holds: the first loose thing that is `held`.

        If it is none, the boxes tell it."""
        own = self.task.start(key, 0.0)  # nothing of it is sampled
        home, layout, tilt = jnp.asarray(self._home), self.task.layout, self.task.tilt
        start, grip = from_boxes.start_from(
            center, size, layout, self.camera, own, self._things_of, held, home, tilt
        )
        start, arm, there = resting.hand_at(home, start, grip, layout, self._things_of, tilt)
        data = self._at_rest(arm, start, grip.opening)
        press = jnp.where(grip.held >= 0, kinematics.GRIP_RANGE[0], grip.opening)
        data = data._replace(target=data.target.at[7].set(press))
        # What lies is the same without the hand, what is held would fall.
        without = jax.tree.map(lambda a, b: jnp.where(grip.held >= 0, a, b), own, start)
        data = jax.tree.map(lambda a, b: jnp.where(there, a, b), data, self._with_arm(key, without))
        return self._observe(*[data] * 2)

    def _things_of(self, joints: Float[Array, "J"], fixtures: Float[Array, "M 7"]) -> Boxes:
        """Boxes of the task's things, by its joints and fixtures alone."""
        start = Start(joints, fixtures, jnp.zeros((), bool))
        return self.task.boxes(self.view(self._at_rest(jnp.asarray(self._home), start, 0.0)))

    def _begin(self, key: PRNGKeyArray) -> TabletopData:
        """The task's own beginning."""
        key_start, key_arm = jax.random.split(key)
        return self._with_arm(key_arm, self.task.start(key_start, self.jitter))

    def _with_arm(self, key: PRNGKeyArray, start: Start) -> TabletopData:
        """A start with the arm about its home."""
        noise = self.jitter * _ARM_NOISE * jax.random.normal(key, (7,))
        return self._at_rest(self._home + noise, start, kinematics.FINGER_RANGE[1])

    def _at_rest(self, arm, start: Start, opening) -> TabletopData:
        fingers = jnp.full((2,), opening)
        motion = self.physics.start(jnp.concatenate([arm, fingers, start.joints]))
        return TabletopData(
            motion, jnp.concatenate([arm, fingers[:1]]), start.fixtures,
            jnp.zeros(self.action_size), rewards.no_record(len(self.stage_names)),
            jnp.zeros((), jnp.int32), start.unplaced, jnp.zeros((), bool),
        )  # fmt: skip

    def _within(self, moment: Moments) -> tuple[TabletopData, Bool[Array, "N"]]:
        """A state of a recorded episode, and the objects that have moved by then."""
        motion = self.physics.start(moment.qpos)._replace(qvel=moment.qvel)
        zero, no = jnp.zeros((), jnp.int32), jnp.zeros((), bool)
        stage_time = jnp.where(moment.reached, 0, -1).astype(jnp.int32)
        record = Record(stage_time, zero, moment.best.astype(jnp.int32))
        return TabletopData(
            motion, moment.target, moment.fixtures, jnp.zeros(self.action_size), record, zero, no,
            ~no,
        ), moment.moved  # fmt: skip

    def step(self, state: State, action: Float[Array, "A"]) -> State:
        """Advances one control step: 50 ms under a held aim."""
        before = state.data
        action = jnp.clip(action, -1.0, 1.0)
        target = kinematics.aim(
            before.target, before.motion.qpos[:7], action,
            rest=jnp.asarray(self._home), dt=self.physics.dt, tilt=self.task.tilt,
        )  # fmt: skip
        motion = self.physics.step(before.motion, target, before.fixtures)
        changed = dict(motion=motion, target=target, action=action, time=before.time + 1)
        return self._observe(before, before._replace(**changed))

    def view(self, data: TabletopData) -> View:
        """The scene as far as it can be read without asking the simulator."""
        motion, own = data.motion, panda_model.DOFS
        hand, *fingers = _hand(motion)
        pads = [boxes.box(f, panda_model.PAD_CENTER, panda_model.PAD_HALF) for f in fingers]
        tcp = Frame(hand.position + kinematics.TCP * hand.rotation[:, 2], hand.rotation)
        return View(
            tcp, boxes.stacked(pads), motion.qpos[own:], motion.qvel[own:], data.fixtures,
            data.record.reached,
        )  # fmt: skip

    def world_boxes(self, data: TabletopData) -> Boxes:
        """Boxes in space of left finger, right finger, hand, and the task's objects."""
        return self._with_robot(data, self.task.boxes(self.view(data)))

    def picture_boxes(self, data: TabletopData) -> tuple[Float[Array, "N 2"], Float[Array, "N 2"]]:
        """Centres and sizes of the same boxes in the picture, of what can be seen of them."""
        view = self.view(data)
        seen = self.task.seen(view, self.task.boxes(view))
        return boxes.project(self.camera, self._with_robot(data, seen))

    def _with_robot(self, data: TabletopData, things: Boxes) -> Boxes:
        qpos = data.motion.qpos
        own = boxes.robot(kinematics.hand(qpos[:7]), qpos[7], qpos[8])
        return Boxes(*(jnp.concatenate(x) for x in zip(own, things, strict=True)))

    def _observe(self, before: TabletopData, data: TabletopData) -> State:
        """The state after a step that began at `before`, with its record updated."""
        view, told = self.view(data), len(self._told)
        things = self.task.boxes(view)
        progress = self.task.progress(view, things)
        data = data._replace(record=rewards.record(before.record, progress, data.time))
        center, size = self.picture_boxes(data)
        count = len(self.classes)
        change = data.action - before.action
        done, success = progress.done.astype(jnp.float32), data.record.success.astype(jnp.float32)
        stages = zip(self.stage_names, done, strict=True)
        return State(
            data=data,
            obs=observations.observe(
                data.motion, data.target, view.hand, things, data.record.reached[:told], data.action
            ),
            objects=Objects(center, size, jnp.arange(count), jnp.arange(count) < len(_ROBOT)),
            moved=jnp.zeros(count, bool),
            reward=rewards.reward(self._reward, before.record, data.record, progress, change),
            done=jnp.zeros(()),
            metrics={
                "score": jnp.maximum(jnp.mean(done), success),
                "success": success,
                "unplaced": data.unplaced.astype(jnp.float32),
                "varied": data.varied.astype(jnp.float32),
                **{f"stage {name}": held for name, held in stages},
            },
        )

    def outlines(self, data: TabletopData) -> list[Outline]:
        """The outlines of one state (host side): boxes as the camera sees them, far to near."""
        found = self.world_boxes(jax.tree.map(jnp.asarray, data))
        seen = [*zip(*jax.tree.map(np.asarray, found), strict=True)]
        away = [np.linalg.norm(place - np.array(self.camera.place)) for place, *_ in seen]
        shapes = [boxes.outline(self.camera, *thing) for thing in seen]
        return [
            Outline(shapes[i], self._colour(int(i)), (30, 30, 30)) for i in np.argsort(away)[::-1]
        ]

    def _colour(self, index: int) -> tuple[int, int, int]:
        own = index - len(_ROBOT)
        if own < 0 or not self.task.colours:
            return _COLOURS[index % len(_COLOURS)]
        red, green, blue = (int(255 * x) for x in self.task.colours[own])
        return red, green, blue
