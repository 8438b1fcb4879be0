"""A scripted expert for shoes in the box, and the ways in which demonstrations of it fail.

It plays in C MuJoCo (`tabletop_hand`): about 0.15 s an episode on a CPU. Grasps are of friction, so
each episode is judged by the task itself, from recorded positions, and the script only proposes.

  "success"            lid, then both shoes in either order
  "lid only"           the lid, then nothing
  "one shoe"           the lid and one shoe
  "shoe outside"       the other shoe is let go beside the box
  "lid closed again"   the lid is pushed shut when one shoe is in, or none
  "stops early"        a success that breaks off at some moment
  "wrong order"        a shoe is put on the closed lid before that is opened
  "shoe knocked away"  a shoe is struck out of reach, the other put in
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.base import State
from gril_jax.envs.panda import model as panda_model
from gril_jax.envs.tabletop import camera as cameras
from gril_jax.envs.tabletop import reward as rewards
from gril_jax.envs.tabletop.boxes import Boxes
from gril_jax.envs.tabletop.hand import Hand
from gril_jax.envs.tabletop.task import Tabletop
from jaxtyping import Bool, Float, Int

from . import moves
from .marks import shows
from .style import Style, draw

__all__ = ["KINDS", "Run", "judge", "perform", "play"]

_LIMIT = 900  # control steps; a script that meets no trouble takes half of them
_AFTER = 10  # moments kept after success


class Run(NamedTuple):
    """One recorded episode: T moments at the control rate, the first of them the reset's."""

    kind: str  # one of `KINDS`: what the script tried
    qpos: Float[np.ndarray, "T Q"]
    qvel: Float[np.ndarray, "T V"]
    fixtures: Float[np.ndarray, "M 7"]
    boxes: Boxes  # in space, of the N objects in the order of the environment's classes: (T, N, ..)
    center: Float[np.ndarray, "T N 2"]  # the same boxes in the camera's picture: middles,
    size: Float[np.ndarray, "T N 2"]  # widths and heights
    stage_time: Int[np.ndarray, "K"]  # control steps after which each stage first held; -1 never
    stages: Bool[np.ndarray, "T K"]  # which hold at each moment
    success: Bool[np.ndarray, "T"]

    @property
    def succeeded(self) -> bool:
        """Whether it ends in success."""
        return bool(self.success[-1])

    @property
    def as_meant(self) -> bool:
        """Whether it is what its kind says."""
        if self.succeeded or self.kind == "success":
            return self.succeeded and self.kind == "success"
        shoes = self.boxes.position[:, -2:]
        lid, box = self.qpos[:, panda_model.DOFS], self.fixtures[0, :2]
        return shows(self.kind, shoes, lid, self.stages[-1, 1:], box)


def play(env: Tabletop, start: State, seed: int | tuple[int, ...], kind: str = "success") -> Run:
    """Play one episode.

    Args:
      env: shoes in the box, controller "ee_delta_yaw".
      start: of its `reset`, one lane.
      seed: of the style and of what a failure leaves open.
      kind: one of `KINDS`.

    Returns:
      The episode; that of a success ends half a second after it. A script can miss its aim: check
      `as_meant`.

    Raises:
      ValueError: the kind or the controller is unknown.
    """
    rng = np.random.default_rng(seed)
    hand = perform(env, start, rng, kind)
    run = judge(env, start, kind, np.stack(hand.positions), np.stack(hand.velocities))
    length = len(run.qpos)
    if run.success.any():
        first = int(run.success.argmax())
        length = min(length, first + 1 + _AFTER)
        if kind == "stops early":
            length = max(10, int(first * rng.uniform(0.15, 0.95)))
    return _cut(run, length)


def perform(env: Tabletop, start: State, rng: np.random.Generator, kind: str = "success") -> Hand:
    """The same, as the hand has recorded it, before anybody judges it; raises the same."""
    if kind not in KINDS:
        raise ValueError(f"kind is {kind!r}, but must be one of {', '.join(KINDS)}")
    style, hand = draw(rng), Hand(env, start, limit=_LIMIT)
    hand.rest(style.pauses[0])
    KINDS[kind](hand, style, rng)
    hand.rest(_AFTER)
    return hand


def judge(env: Tabletop, start: State, kind: str, qpos, qvel) -> Run:
    """What the task says of recorded positions (T, Q) and velocities (T, V)."""
    count = len(qpos)
    padded = [x[np.minimum(np.arange(_LIMIT + 1), count - 1)] for x in (qpos, qvel)]
    stage_time, *seen = jax.device_get(_judge(env)(start.data, *padded))
    boxes, center, size, stages, success = jax.tree.map(lambda x: x[:count], seen)
    fixtures = np.asarray(start.data.fixtures)
    return Run(
        kind, qpos, qvel, fixtures, boxes, center, size, stage_time, stages, success
    )  # fmt: skip


@functools.lru_cache(maxsize=4)
def _judge(env: Tabletop) -> Callable:
    """The task's own judgement, moment by moment, compiled once for an environment."""

    def judge(data, qpos, qvel):
        def look(record, now):
            qpos, qvel, time = now
            motion = data.motion._replace(qpos=qpos, qvel=qvel)
            moment = data._replace(motion=motion, record=record)
            view = env.view(moment)
            progress = env.task.progress(view, env.task.boxes(view))
            record = rewards.record(record, progress, time)
            boxes = env.world_boxes(moment)
            picture = cameras.project(env.camera, boxes)
            return record, (boxes, *picture, progress.done, record.success)

        blank = rewards.no_record(len(env.stage_names))
        times = jnp.arange(len(qpos), dtype=jnp.int32)
        record, seen = jax.lax.scan(look, blank, (qpos, qvel, times))
        return record.stage_time, *seen

    return jax.jit(judge)


def _cut(run: Run, length: int) -> Run:
    """The first moments."""
    lasting = ("kind", "fixtures", "stage_time")
    moments = {name: part for name, part in run._asdict().items() if name not in lasting}
    stage_time = np.where(run.stage_time < length, run.stage_time, -1)
    return run._replace(stage_time=stage_time, **jax.tree.map(lambda x: x[:length], moments))


# ---------------------------------------------------------------- scripts


def _put(hand: Hand, style: Style, number: int, *, where=None) -> None:
    """Take the shoe whose turn is `number` and let it go in the box, or elsewhere."""
    hand.rest(style.pauses[1 + number])
    moves.take(hand, style, style.order[number])
    moves.carry(hand, style, style.drops[number] if where is None else where)
    moves.release(hand, style, pause=style.pauses[3 + number])


def _success(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    moves.open_lid(hand, style)
    _put(hand, style, 0)
    _put(hand, style, 1)


def _lid_only(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    moves.open_lid(hand, style)
    _wander(hand, style, rng)


def _one_shoe(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    moves.open_lid(hand, style)
    _put(hand, style, 0)
    _wander(hand, style, rng)


def _outside(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    moves.open_lid(hand, style)
    _put(hand, style, 0)
    _put(hand, style, 1, where=(rng.uniform(-0.12, 0.12), rng.uniform(0.2, 0.26), 0.1))
    _wander(hand, style, rng)


def _closed_again(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    moves.open_lid(hand, style)
    if rng.random() < 0.5:
        _put(hand, style, 0)
    moves.close_lid(hand, style)


def _wrong_order(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    x, y, _ = style.drops[0]
    _put(hand, style, 0, where=(x, y, 0.2))
    moves.open_lid(hand, style)
    _put(hand, style, 1)


def _knocked(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    moves.open_lid(hand, style)
    angle = moves.box_yaw(hand) + rng.uniform(-0.4, 0.4)  # away from the robot
    moves.knock(hand, style, style.order[1], (np.cos(angle), np.sin(angle)))
    _put(hand, style, 0)


def _wander(hand: Hand, style: Style, rng: np.random.Generator) -> None:
    """Somewhere above the table, and rest there."""
    goal = (rng.uniform(0.4, 0.55), rng.uniform(-0.15, 0.25), rng.uniform(0.3, 0.45))
    hand.move(goal, speed=style.carry_speed)
    hand.rest(int(rng.integers(5, 40)))


KINDS: dict[str, Callable[[Hand, Style, np.random.Generator], None]] = {
    "success": _success,
    "lid only": _lid_only,
    "one shoe": _one_shoe,
    "shoe outside": _outside,
    "lid closed again": _closed_again,
    "stops early": _success,
    "wrong order": _wrong_order,
    "shoe knocked away": _knocked,
}
