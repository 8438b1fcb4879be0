"""Scripted episodes of a table task, recorded and judged by the task itself, and their states.

Scripts play in C MuJoCo (`moves`). Grasps are of friction, so that a script only proposes.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import State
from gril_jax.envs.checks import check_known
from jaxtyping import Bool, Float, Int

from . import reward as rewards
from .boxes import Boxes
from .environment import Tabletop
from .moves import Hand
from .start import Moments

LIMIT = 900  # control steps of an episode; a script that meets no trouble takes half of them
_EVERY = 4  # control steps from one kept state to the next: a fifth of a second
_MOVED = 0.005  # box diagonals by which a thing has moved: the paper's tau


class Run(NamedTuple):
    """One recorded episode: T steps at the control rate, the first of them the reset's."""

    kind: str  # what the script tried: "success", or a failure
    qpos: Float[np.ndarray, "T Q"]
    qvel: Float[np.ndarray, "T V"]
    fixtures: Float[np.ndarray, "M 7"]
    boxes: Boxes  # in space, of the N objects in the order of the environment's classes: (T, N, ..)
    center: Float[np.ndarray, "T N 2"]  # the same boxes in the camera's picture: middles,
    size: Float[np.ndarray, "T N 2"]  # widths and heights
    stage_time: Int[np.ndarray, "K"]  # control steps after which each stage first held; -1 never
    stages: Bool[np.ndarray, "T K"]  # which hold in each frame
    success: Bool[np.ndarray, "T"]

    @property
    def succeeded(self) -> bool:
        """True if it ends in success."""
        return bool(self.success[-1])


def judge(env: Tabletop, start: State, kind: str, hand: Hand) -> Run:
    """The episode that a hand has recorded in at most `LIMIT` steps, as the task judges it."""
    qpos, qvel = np.stack(hand.positions), np.stack(hand.velocities)
    count = len(qpos)
    padded = [x[np.minimum(np.arange(LIMIT + 1), count - 1)] for x in (qpos, qvel)]
    stage_time, *seen = jax.device_get(_judge(env)(start.data, *padded))
    boxes, center, size, stages, success = jax.tree.map(lambda x: x[:count], seen)
    fixtures = np.asarray(start.data.fixtures)
    return Run(kind, qpos, qvel, fixtures, boxes, center, size, stage_time, stages, success)


@functools.lru_cache(maxsize=4)
def _judge(env: Tabletop) -> Callable:
    """The task's verdict, step by step, compiled once for an environment."""

    def judge(data, qpos, qvel):
        def look(record, now):
            qpos, qvel, time = now
            motion = data.motion._replace(qpos=qpos, qvel=qvel)
            moment = data._replace(motion=motion, record=record)
            view, boxes = env.view(moment), env.world_boxes(moment)
            progress = env.task.progress(view, env.task.boxes(view))
            record = rewards.record(record, progress, time)
            seen = boxes, *env.picture_boxes(moment), progress.done, record.success
            return record, seen

        blank = rewards.no_record(len(env.stage_names))
        times = jnp.arange(len(qpos), dtype=jnp.int32)
        record, seen = jax.lax.scan(look, blank, (qpos, qvel, times))
        return record.stage_time, *seen

    return jax.jit(judge)


def cut(run: Run, length: int) -> Run:
    """The first `length` frames."""
    lasting = ("kind", "fixtures", "stage_time")
    moments = {name: part for name, part in run._asdict().items() if name not in lasting}
    stage_time = np.where(run.stage_time < length, run.stage_time, -1)
    return run._replace(stage_time=stage_time, **jax.tree.map(lambda x: x[:length], moments))


def moments(env: Tabletop, perform: Callable[..., Hand], *, episodes: int = 24) -> Moments:
    """Every fourth state of an expert's successful episodes, until success begins.

    `perform` is (env, start, generator) -> the hand after an episode. Of the episodes, 0.2 s each,
    a few may fail, and are left out.
    """
    starts = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), episodes))
    found = []
    for number in range(episodes):
        start = jax.tree.map(lambda x, i=number: x[i], starts)
        hand = perform(env, start, np.random.default_rng((0, number)))
        run = judge(env, start, "success", hand)
        if run.succeeded:
            found.append(_moments_of(run, np.stack(hand.targets)))
    return Moments(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _moments_of(run: Run, target) -> Moments:
    chosen = np.arange(0, int(run.success.argmax()), _EVERY)
    diagonal = np.linalg.norm(run.size[0], axis=-1)
    away = np.linalg.norm(run.center - run.center[0], axis=-1) > _MOVED * diagonal
    reached = np.logical_or.accumulate(run.stages, axis=0)
    best = np.maximum.accumulate(run.stages.sum(axis=1))
    fixtures = np.broadcast_to(run.fixtures, (len(run.qpos), *run.fixtures.shape))
    everything = Moments(
        run.qpos, run.qvel, target, fixtures, reached, best, np.logical_or.accumulate(away, axis=0)
    )
    return Moments(*(part[chosen] for part in everything))


AFTER = 10  # frames kept after success
EARLY = "stops early"  # the kind of failure that every script has: a success that breaks off


class Script(NamedTuple):
    """A task's scripted expert, and the ways in which it fails."""

    kinds: tuple[str, ...]
    """"success", then the failures in the order in which they are shown, `EARLY` among them."""
    follow: Callable[[Hand, np.random.Generator, str], None]
    """(hand, generator, kind): plays an episode; the generator is of its style, too."""
    shows: Callable[[Run], bool]
    """True if positions alone show that an episode without success is of its kind of failure."""

    def perform(
        self, env: Tabletop, start: State, rng: np.random.Generator, kind: str = "success"
    ) -> Hand:
        """The hand after an episode that nobody has judged yet; arguments, errors as for `play`."""
        check_known("kind", kind, self.kinds)
        hand = Hand(env, start, limit=LIMIT)
        self.follow(hand, rng, kind)
        hand.rest(AFTER)
        return hand

    def play(
        self, env: Tabletop, start: State, seed: int | tuple[int, ...], kind: str = "success"
    ) -> Run:
        """Plays one episode; that of a success ends half a second after it.

        `start` is of the task's `reset`; the seed is of the style and of what a failure leaves
        open. A script can miss its aim: check `as_meant`.

        Raises:
          ValueError: the kind is none of `kinds`.
        """
        rng = np.random.default_rng(seed)
        hand = self.perform(env, start, rng, kind)
        run = judge(env, start, kind, hand)
        length = len(run.qpos)
        if run.success.any():
            first = int(run.success.argmax())
            length = min(length, first + 1 + AFTER)
            if kind == EARLY:
                length = max(10, int(first * rng.uniform(0.15, 0.95)))
        return cut(run, length)

    def as_meant(self, run: Run) -> bool:
        """True if an episode succeeds, or fails, as its kind says."""
        if run.succeeded or run.kind == "success":
            return run.succeeded and run.kind == "success"
        return run.kind == EARLY or bool(self.shows(run))
