"""Synthetic states with known true progress, for judging a reward before training a policy.

The inputs are one start of a task and its stage definition (`gril_jax.envs.stages.Stages`). Chains
of states lead from the start to success, stage by stage. In the states around them a single thing
is other than it should be:

    touched        every activity bit set, nothing else
    wrong place    the next stage's objects moved, but not to where the stage holds
    detour         the same on the way to their places, by way of a random point
    robot          the robot moved alone
    undone         a stage's objects back where they began
    wrong object   a fault committed, with nothing done or with everything done
    scattered      everything done, and the objects of no stage pushed to other places
    random         any objects anywhere, any stages done

True progress is the task's own score. An object that has moved has its activity bit set, and the
robot has its own once anything has moved. Boxes have the sizes that the task says. Shapes use N for
objects, S for states, G for those of a group, L for those of a chain and P for pairs of states.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .scene_reward import Scene, StagedTask, activity_bits, can_move

FACTORS = (
    "start", "progress", "success", "touched", "wrong place", "detour", "robot", "undone",
    "wrong object", "scattered", "random",
)  # fmt: skip

SUCCESS = 0.999  # true progress that counts as success
_PLACES = 8  # samples of each factor around each state
_FRAMES = 6  # of a detour, before and after its random point
_SUCCESSES = 16
_RANDOM = 128
_ANYWHERE = 512


class Battery(NamedTuple):
    """States around one start, and pairs of them to compare where their scores differ."""

    scenes: Scene  # leading axis S; the first is the start
    score: Float[Array, "S"]  # true progress
    factor: Int[Array, "S"]  # index into FACTORS
    first: Int[Array, "P"]
    second: Int[Array, "P"]
    pair_factor: Int[Array, "P"]


class _Group(NamedTuple):
    """States of one factor."""

    factor: str
    center: Float[Array, "G N 2"]
    touched: Bool[Array, "N"] | None = None  # bits that are set besides those of what has moved


def battery(key: PRNGKeyArray, task: StagedTask, start: Scene) -> Battery:
    """All states around one start, the state after a reset; batch over keys and starts.

    The key, of the places that are sampled, is consumed.
    """
    ways = orders(task)
    keys = jax.random.split(key, len(ways) + 2)
    groups = [_Group("start", start.center[None])]
    around = []
    for order, key_order in zip(ways, keys[2:], strict=True):
        key_chain, key_around = jax.random.split(key_order)
        chain = _chain(key_chain, task, start, order)
        groups.append(_Group("progress", chain[1:]))
        around += _around(key_around, task, start, order, chain)
    complete = chain[-1]
    fixed = sum(len(group.center) for group in groups)  # states that others are compared with
    groups += around + _complete(keys[0], task, start, complete)
    groups.append(_Group("random", _random(keys[1], task, start)))
    return _compared(task, start, groups, fixed)


def successes(key: PRNGKeyArray, task: StagedTask, start: Scene) -> Scene:
    """512 states sampled from all successes around one start; a few may be none.

    Objects of stages are anywhere where their stages hold; each other one, the robot included, is
    pushed anywhere or rests, with equal probability. The key is consumed.
    """
    placed = {i for stage in task.stages for i in stage.moves}
    others = [i for i in (*task.movable, *task.robots) if i not in placed]

    def one(key):
        keys = jax.random.split(key, 3)
        pushed = jax.random.bernoulli(keys[0], 0.5, (len(start.center), 1))
        center = task.fulfil(keys[1], start.center, start.size)
        if others:
            anywhere = _scatter(keys[2], task, others, center, start.size)
            center = jnp.where(pushed, anywhere, center)
        size = task.sizes(center, start.size)
        active = activity_bits(start, center)
        return start._replace(center=center, size=size, active=active)

    return jax.vmap(one)(jax.random.split(key, _ANYWHERE))


def orders(task: StagedTask) -> list[tuple[int, ...]]:
    """The declared order of the stages, and the most different one that requirements allow."""
    names = [stage.name for stage in task.stages]
    last: list[int] = []
    for _ in names:
        done = {names[i] for i in last}
        ready = [s.name for s in task.stages if done.issuperset(s.required_before)]
        last.append(names.index([name for name in ready if name not in done][-1]))
    declared = tuple(range(len(names)))
    return [declared] if tuple(last) == declared else [declared, tuple(last)]


def _chain(key, task, start, order) -> Float[Array, "L N 2"]:
    states = [start.center]
    for index, key_stage in zip(order, jax.random.split(key, len(order)), strict=True):
        states.append(task.stages[index].place(key_stage, states[-1], start.size))
    return jnp.stack(states)


def _around(key, task, start, order, chain) -> list[_Group]:
    """Single-factor states around each incomplete state of a chain."""
    keys = jax.random.split(key, len(order) + 1)
    groups = [_Group("touched", chain[:-1], can_move(task, start))]
    for level, index in enumerate(order):
        stage, center = task.stages[index], chain[level]
        key_detour, *draws = jax.random.split(keys[level], _PLACES + 1)
        astray = jax.vmap(lambda k, s=stage, c=center: task.astray(k, s, c, start.size))
        groups.append(_Group("wrong place", astray(jnp.stack(draws))))
        groups.append(_Group("detour", _detour(key_detour, task, start, stage, chain, level)))
    if task.robots:
        drive = lambda k, c: _scatter(k, task, task.robots, c, start.size)  # noqa: E731
        many = jnp.repeat(chain[:-1], _PLACES, axis=0)
        groups.append(_Group("robot", jax.vmap(drive)(jax.random.split(keys[-1], len(many)), many)))
    return groups


def _complete(key, task, start, complete) -> list[_Group]:
    """States around success, and faults with nothing done."""
    keys = jax.random.split(key, 3)
    free = [i for i in task.movable if not any(i in stage.moves for stage in task.stages)]
    placed = jax.vmap(lambda k: _chain(k, task, start, range(len(task.stages)))[-1])
    moves = [jnp.array(stage.moves) for stage in task.stages]
    undone = [complete.at[which].set(start.center[which]) for which in moves]
    groups = [
        _Group("success", placed(jax.random.split(keys[0], _SUCCESSES))),
        _Group("undone", jnp.stack(undone), activity_bits(start, complete)),
    ]
    both = jnp.stack([start.center, complete])
    each = jax.random.split(keys[1], len(task.faults))
    for fault, key_fault in zip(task.faults, each, strict=True):
        faulty = jax.vmap(lambda k, c, fault=fault: fault.place(k, c, start.size))
        groups.append(_Group("wrong object", faulty(jax.random.split(key_fault), both)))
    if free:
        scattered = jax.vmap(lambda k: _scatter(k, task, free, complete, start.size))
        groups.append(_Group("scattered", scattered(jax.random.split(keys[2], _PLACES))))
    return groups


def _detour(key, task, start, stage, chain, level) -> Float[Array, "G N 2"]:
    """Moves the stage's objects straight to random points, and from there to their places."""
    limit = task.limit(start.size)
    anywhere = jax.random.uniform(key, limit.shape, minval=-limit, maxval=limit)
    moved = jnp.array([i in stage.moves for i in range(len(limit))])[:, None]
    over = jnp.where(moved, anywhere, chain[level])
    share = jnp.arange(1, _FRAMES + 1)[:, None, None] / (_FRAMES + 1)
    away = chain[level] + share * (over - chain[level])
    way = jnp.concatenate([away, over[None], over + share * (chain[level + 1] - over)])
    return jax.vmap(lambda center: task.possible(center, start.size))(way)


def _random(key, task, start) -> Float[Array, "G N 2"]:
    """Random states: stages done or their objects astray or at rest; others anywhere or resting."""

    def one(key):
        keys = jax.random.split(key, 4)
        movable = (*task.movable, *task.robots)
        anywhere = _scatter(keys[0], task, movable, start.center, start.size)
        pushed = jax.random.bernoulli(keys[1], 0.5, (len(start.center), 1))
        center = jnp.where(pushed, anywhere, start.center)
        wanted = jax.random.bernoulli(keys[2], 0.5, (len(task.stages),))
        return task.arrange(keys[3], center, start.size, wanted)

    return jax.vmap(one)(jax.random.split(key, _RANDOM))


def _scatter(key, task, indices, center, size) -> Float[Array, "N 2"]:
    """Places these objects anywhere on the plane, clear of others."""

    def place(center, x):
        return task.scatter(x[0], x[1], center, size), None

    keys = jax.random.split(key, len(indices))
    return jax.lax.scan(place, center, (keys, jnp.array(indices)))[0]


def _compared(task, start, groups, fixed) -> Battery:
    """Pairs every state with every state of the chains, and random states with each other."""
    center = jnp.concatenate([group.center for group in groups])
    none = jnp.zeros(len(start.center), bool)
    touched = [none if group.touched is None else group.touched for group in groups]
    counts = [len(group.center) for group in groups]
    touched = jnp.concatenate([jnp.tile(t, (n, 1)) for t, n in zip(touched, counts, strict=True)])
    active = jax.vmap(lambda c: activity_bits(start, c))(center) | touched
    size = jax.vmap(lambda c: task.sizes(c, start.size))(center)
    same = (jnp.broadcast_to(x, (len(center), *x.shape)) for x in (start.label, start.is_robot))
    factor = [FACTORS.index(g.factor) for g in groups for _ in range(len(g.center))]
    ordered = len(center) - _RANDOM
    pairs = [(a, b) for a in range(1, ordered) for b in range(min(a, fixed))]
    pairs += [(a, a + d) for d in (1, 2) for a in range(ordered, len(center) - d)]
    first, second = jnp.array(pairs, jnp.int32).T
    return Battery(
        scenes=Scene(center, size, *same, active),
        score=jax.vmap(lambda c: task.progress(c, start.size))(center),
        factor=jnp.array(factor, jnp.int32),
        first=first,
        second=second,
        pair_factor=jnp.array([factor[a] for a, _ in pairs], jnp.int32),
    )
