"""States from which a search for shortfalls begins, and the moves that keep it to shortfalls.

A beginning is one of six. With nothing done, it is random, or on the brink of success. Others are
successes with one change: a stage never begun, an object moved away, an object at the brink, or a
fault. A brink is the last clear shortfall on a straight way to a success.

An object either moves, and then its activity bit is set, or rests where the episode began, and then
its bit is sampled at random. The objects of a stage that was never begun have no bit.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from .scene_reward import Scene, StagedTask, can_move
from .shortfalls import counting, margin, moved_by_stages, scores_near
from .states import SUCCESS

_SHARES = {"random": 3, "brink": 3, "missing": 2, "undone": 4, "outside": 4, "intruder": 4}
_HALVINGS = 16  # of the way to a success, until its brink


class Beginning(NamedTuple):
    """A state to search from."""

    scene: Scene
    moves: Bool[Array, "N"]  # the objects that the search moves
    most: Float[Array, ""]  # the highest true progress that it may come to


def beginning(key: PRNGKeyArray, task: StagedTask, start: Scene) -> Beginning:
    """A random beginning around the state after a reset; the key is consumed."""
    keys = jax.random.split(key, 10)
    able, limit = can_move(task, start), task.limit(start.size)
    moves = able & (jax.random.uniform(keys[0], able.shape) < jax.random.uniform(keys[1]))
    anywhere = jax.random.uniform(keys[2], limit.shape, minval=-limit, maxval=limit)
    goal = jnp.where(moves[:, None], anywhere, start.center)
    nothing = towards(task, start, start.center, goal, 0.0)
    success = task.fulfil(keys[3], nothing, start.size)
    never = jax.random.choice(keys[4], moved_by_stages(task, len(able)))
    ever = jnp.array(sorted({i for stage in task.stages for i in stage.moves}))
    placed = jax.random.choice(keys[5], ever)
    undone = task.scatter(keys[6], placed, success, start.size)
    ways = {
        "random": nothing,
        "brink": _brink(task, start, nothing, success, 0.0),
        "missing": jnp.where(never[:, None], start.center, success),
        "undone": undone,
        "outside": _brink(task, start, undone, success, 1.0),
    }
    if task.faults:
        each = jax.random.split(keys[7], len(task.faults))
        both = zip(task.faults, each, strict=True)
        faulty = jnp.stack([fault.place(k, success, start.size) for fault, k in both])
        ways["intruder"] = jax.random.choice(jax.random.fold_in(keys[7], 0), faulty)
    share = jnp.array([_SHARES[name] for name in ways], jnp.float32)
    way = jax.random.categorical(keys[8], jnp.log(share))
    center = jnp.stack([*ways.values()])[way]
    rests = never & (way == [*ways].index("missing"))
    moves = able & (moves | (center != start.center).any(axis=1)) & ~rests
    active = moves | (able & ~rests & jax.random.bernoulli(keys[9], 0.5, able.shape))
    active |= start.is_robot & active.any()
    most = jnp.where(way < [*ways].index("missing"), 0.0, 1.0)
    return Beginning(start._replace(center=center, active=active), moves, most)


def towards(
    task: StagedTask,
    start: Scene,
    center: Float[Array, "N 2"],
    goal: Float[Array, "N 2"],
    most: Float[Array, ""] | float,
) -> Float[Array, "N 2"]:
    """Moves towards `goal`, one object and axis at a time, and never to what is no clear shortfall.

    So an object slides along the edge of where it would count. Progress stays at `most` or below,
    and objects go only where the scene's mechanics allow. Each move looks at the margin of the
    object that it moves.
    """
    goal = task.possible(goal, start.size)
    which = counting(task)
    free = jnp.array([i not in which for i in range(len(center))])[:, None]
    center = jnp.where(free, goal, center)

    def go(center, at):
        moved = center.at[at[0], at[1]].set(goal[at[0], at[1]])
        moved = task.possible(moved, start.size)
        kept = _keeps_out(task, start, moved, at[:1], most)
        return jnp.where(kept, moved, center), None

    return jax.lax.scan(go, center, jnp.array([(i, axis) for i in which for axis in range(2)]))[0]


def _keeps_out(task, start, center, which, most) -> Bool[Array, ""]:
    """True if no object of these, shifted by the margin, makes a success, nor progress too high."""
    near = scores_near(task, start, center, which, margin(task))
    return (near[0] <= most) & (near < SUCCESS).all()


def _brink(task, start, outside, success, most) -> Float[Array, "N 2"]:
    """Halves the way between a shortfall and a success until both ends meet."""
    which = jnp.array(counting(task))
    at = lambda share: task.possible(outside + share * (success - outside), start.size)  # noqa: E731

    def halve(ends, _):
        low, high = ends
        middle = (low + high) / 2
        kept = _keeps_out(task, start, at(middle), which, most)
        return (jnp.where(kept, middle, low), jnp.where(kept, high, middle)), None

    (share, _), _ = jax.lax.scan(halve, (jnp.float32(0), jnp.float32(1)), length=_HALVINGS)
    return at(share)
