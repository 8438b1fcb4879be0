"""Dead ends of a table task that a reward pays for: found by pushes, before a policy finds them.

    python -m gril_jax.experiments.tabletop.dead_ends reward.npz --task shoes_in_box
    python -m gril_jax.experiments.tabletop.dead_ends --near 0.5       # before anything is learned

An audit knows what places are worth, and not which of them cannot be left. Here the simulator says
that. From moments of the scripted expert's episodes a closed hand pushes one thing after another,
half of the times anywhere, else to where the reward rises most, as a policy would; then the expert
tries to finish the task from there, with the arm at home. A state is a dead end if none of its
tries succeeds, though one did before the pushes. The expert is a witness for what can be reached,
not a proof of what cannot: it does not pull a shoe off a wall, nor does a policy that has never
seen it done. Shapes use N for objects and P for pushes.
"""

import functools
import pkgutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from gril_jax.envs.checks import check_counts
from gril_jax.envs.panda.kinematics import FINGER_RANGE
from gril_jax.envs.panda.model import DOFS
from gril_jax.envs.tabletop import moves
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.envs.tabletop.environment import Tabletop
from gril_jax.envs.tabletop.hand import Hand
from gril_jax.envs.tabletop.recorded import judge
from gril_jax.envs.tabletop.sight import ROBOTS
from gril_jax.envs.tabletop.start import Start
from gril_jax.experiments.fidelity.physics_parity import printed
from jaxtyping import Float

from gril_jax.audit.scene_reward import Scene, scene_reward
from gril_jax.config.reward import LossConfig
from gril_jax.interop.reward_file import load_reward
from gril_jax.pretraining.final_places import final_places, misplacement
from gril_jax.types import DemoBatch

Pay = Callable[[Float[np.ndarray, "N 2"], Float[np.ndarray, "N 2"]], float]  # of boxes at rest

_STEP = 0.04  # metres: by how much a thing is moved to see where the reward rises
_WAYS = 8  # directions of pushes
_SETTLE = 15  # control steps
_PACE = moves.Pace(0.35, 0.42, (0.0, 0.0))
_EPISODES = 30
_PAID = 0.05  # of the range: a dead end that pays more than this is worth going to


class Push(NamedTuple):
    """A state after some pushes, and the one before."""

    before: float  # what is paid
    after: float
    could: bool  # whether the expert finished from before them
    can: bool  # whether it does from after them
    upwards: bool  # whether they went to where the reward rises

    @property
    def dead(self) -> bool:
        """True for a dead end."""
        return self.could and not self.can


def look(
    env: Tabletop, entry: Entry, pay: Pay, *, pushes: int, tries: int = 2, seed: int = 0
) -> list[Push]:
    """Pushes from so many moments of the expert's, and what became of them."""
    rng = np.random.default_rng(seed)
    known = entry.moments()
    found = []
    for number in range(pushes):
        at = int(rng.integers(len(known.best)))
        begin = _at_rest(env, known.qpos[at], known.fixtures[at])
        upwards = bool(number % 2)
        hand = Hand(env, begin)
        hand.rest(_SETTLE)
        before = _at_rest(env, hand.qpos, known.fixtures[at])
        for _ in range(int(rng.integers(1, 4))):
            _push(env, hand, rng, pay if upwards else None)
        hand.rest(_SETTLE)
        after = _at_rest(env, hand.qpos, known.fixtures[at])
        could = _finishes(env, entry, before, (seed, number), tries)
        can = could and _finishes(env, entry, after, (seed, number), tries)
        found.append(Push(_paid(env, pay, before), _paid(env, pay, after), could, can, upwards))
    return found


def summary(found: list[Push], span: float) -> dict:
    """The figures; gains are shares of the range from a start to success."""
    dead = [push for push in found if push.dead]
    gains = np.array([(push.after - push.before) / span for push in dead])
    left = np.array([(push.after - push.before) / span for push in found if push.can])
    return {
        "pushes": len(found),
        "from_moments_that_the_expert_finishes": sum(push.could for push in found),
        "dead_ends": len(dead),
        "dead_ends_upwards": sum(push.upwards for push in dead),
        "paid_dead_ends": int((gains > _PAID).sum()),
        "most_that_a_dead_end_gains": float(gains.max(initial=0.0)),
        "mean_gain_of_dead_ends": float(gains.mean()) if len(gains) else 0.0,
        "mean_gain_of_the_others": float(left.mean()) if len(left) else 0.0,
    }


def _at_rest(env: Tabletop, qpos, fixtures):
    """The start with these things, and the arm at home."""
    return _starting(env)(jnp.asarray(qpos[DOFS:], jnp.float32), jnp.asarray(fixtures))


@functools.lru_cache(maxsize=2)
def _starting(env: Tabletop):
    home, none = jnp.array(env.task.home, jnp.float32), jnp.zeros((), bool)

    def start(joints, fixtures):
        return env.reset_to(home, Start(joints, fixtures, none), opening=FINGER_RANGE[1])

    return jax.jit(start)


def _paid(env: Tabletop, pay: Pay, state) -> float:
    return pay(*(np.asarray(x) for x in (state.objects.center, state.objects.size)))


def _push(env: Tabletop, hand: Hand, rng: np.random.Generator, pay: Pay | None) -> None:
    """Pushes one free thing along the table: anywhere, or to where the reward rises most."""
    joints = _free_joints(env)
    joint = joints[int(rng.integers(len(joints)))]
    place = moves.pose(hand, joint)
    angles = 2 * np.pi * (np.arange(_WAYS) + rng.random()) / _WAYS
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    way = ways[int(rng.integers(_WAYS))]
    if pay is not None:
        paid = []
        for one in ways:
            qpos = hand.qpos.copy()
            qpos[joint : joint + 2] += _STEP * one
            paid.append(_paid(env, pay, _at_rest(env, qpos, hand.fixtures)))
        way = ways[int(np.argmax(paid))]
    moves.knock(hand, place, _PACE, way, height=0.03, reach=rng.uniform(0.03, 0.3))


@functools.lru_cache(maxsize=8)
def _free_joints(env: Tabletop) -> tuple[int, ...]:
    """First positions of the free things."""
    model = env.physics.mj_model
    return tuple(
        int(a) for a, kind in zip(model.jnt_qposadr, model.jnt_type, strict=True) if not kind
    )


def _finishes(env: Tabletop, entry: Entry, start, seed: tuple[int, int], tries: int) -> bool:
    """True if one of the expert's tries ends in success."""
    for number in range(tries):
        hand = entry.script.perform(env, start, np.random.default_rng((*seed, number)))
        if judge(env, start, "success", hand).succeeded:
            return True
    return False


def pay_of(file: Path, classes: tuple[str, ...]) -> Pay:
    """The reward of a file, of scenes at rest; `classes` are the task's objects.

    Raises:
      ValueError: the reward does not know one of them.
    """
    learned = load_reward(file)
    unknown = [name for name in classes if name not in learned.classes]
    if unknown:
        raise ValueError(f"{file} knows no class {unknown[0]!r}, which the task has")
    label = jnp.array([learned.classes.index(name) for name in classes], jnp.int32)
    pay = jax.jit(scene_reward(learned.config, softness=learned.softness))
    return of_boxes(functools.partial(pay, learned.params), label)


def of_boxes(reward: Callable[[Scene], Float[jax.Array, ""]], label: jax.Array) -> Pay:
    """A reward of scenes as one of boxes alone: the objects' labels, and nothing has moved."""
    robot, rest = jnp.isin(jnp.arange(len(label)), jnp.array(ROBOTS)), jnp.zeros(len(label), bool)
    return lambda center, size: float(reward(Scene(center, size, label, robot, rest)))


def costs(env: Tabletop, entry: Entry, near: float) -> Pay:
    """Minus what displaced copies are taught to cost (`misplacement`), with boxes of whole things.

    What belongs where is read from the ends of the expert's successes in `_EPISODES` episodes.
    """
    starts = jax.device_get(
        jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), _EPISODES))
    )
    played = (
        entry.script.play(env, jax.tree.map(lambda x, i=i: x[i], starts), (0, i))
        for i in range(_EPISODES)
    )
    good = [run for run in played if run.succeeded]
    label, robot = jnp.arange(len(env.classes)), np.isin(np.arange(len(env.classes)), ROBOTS)
    demos = DemoBatch(
        *(jnp.stack([x[np.array([0, -1])] for x in part])
          for part in zip(*((run.center, run.size) for run in good), strict=True)),
        jnp.tile(label, (len(good), 1)), jnp.tile(robot, (len(good), 1)),
        jnp.ones((len(good), len(label)), bool), jnp.full(len(good), 2),
    )  # fmt: skip
    places = final_places(demos, len(label))

    def pay(scene: Scene) -> Float[jax.Array, ""]:
        return -misplacement(
            places, scene.center, scene.size, scene.label, ~scene.is_robot, scene.active, near=near
        )

    return of_boxes(jax.jit(pay), label)


@dataclass(frozen=True)
class _Options:
    reward: Annotated[Path | None, tyro.conf.Positional] = None
    """Reward file, of `gril export-reward`; without it the costs that copies are taught pay."""
    near: float = LossConfig.near
    """Of these costs, as `loss.near`."""
    task: str = "shoes_in_box"
    """Task on the table."""
    pushes: int = 100
    """Moments from which things are pushed."""
    seed: int = 0
    """Seed of moments, pushes and the expert's tries."""


def main(argv: list[str] | None = None) -> int:
    """Prints the figures as JSON."""
    options = tyro.cli(_Options, args=argv)

    def work() -> dict:
        check_counts(pushes=options.pushes)
        entry: Entry = pkgutil.resolve_name(f"gril_jax.envs.tabletop.{options.task}.task:ENTRY")
        env = entry.make()
        if options.reward is None:
            pay, paid_by = costs(env, entry, options.near), f"costs, near {options.near:g}"
        else:
            pay, paid_by = pay_of(options.reward, env.classes), options.reward.name
        found = look(env, entry, pay, pushes=options.pushes, seed=options.seed)
        about = {"task": options.task, "paid by": paid_by, "seed": options.seed}
        return about | summary(found, 1.0)

    return printed("dead ends", work)


if __name__ == "__main__":
    sys.exit(main())
