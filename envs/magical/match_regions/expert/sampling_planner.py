"""The expert of a stick, which can only push: it tries out how to do what a plan says.

The simulator is exact and repeatable, so the expert plays candidate routes to the end of a horizon
with the real physics, takes the one that leaves the scene best, follows its first steps and looks
again. The first round draws routes at random (`push_routes`), the next one varies the best of them,
as the cross-entropy method does. What is left of the route in hand always takes part, so that to
look again never makes the outlook worse. Where nothing helps, it drives off to a random place and
begins anew from there.

The long stick rarely solves the whole task: it moves only across its 1.6 units, in an arena of 2.2,
so it hardly ever comes behind a block near a wall, such as the Demo layout's star.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from gril_jax.envs.base import State
from gril_jax.envs.magical.match_regions.task import MatchRegions
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from . import push_routes as routes
from .plans import Plan
from .push_routes import Route, length

__all__ = ["Search", "cost", "play", "search"]

_EDGE = 0.06  # by which a target's centre should be inside the region
_OUT = 0.03  # by which a distractor's should be outside
_SAFE = 0.01  # by which all of them at once may do
_CLOSE = 0.08  # from a planned place that is not just anywhere in the region
_ROOM = 0.32  # that a block's centre should have on every side
_NONE = 1e4  # cost of no route at all
_NOISE = 0.08  # by which waypoints are varied, standard deviation
_GAIN = 0.01  # less than this between two searches is none


class Search(NamedTuple):
    """The size of a search."""

    candidates: int = 32  # routes a round
    rounds: int = 2
    elite: int = 4  # routes that the next round varies
    horizon: int = 32  # control steps that a candidate is played
    stride: int = 12  # control steps that the best one is followed before looking again


class Pull(NamedTuple):
    """A point that attracts the robot; at weight 0 it is drawn behind the nearest open block."""

    point: Float[Array, "2"]
    weight: Float[Array, ""]  # cost of a unit away from it


class _Memory(NamedTuple):
    route: Route
    cost: Float[Array, ""]  # of the scene at the last search
    whim: Bool[Array, ""]  # the last search went for a random place
    stage: Int[Array, ""]
    since: Int[Array, ""]  # when the stage began
    time: Int[Array, ""]
    over: Bool[Array, ""]  # the plan's last block has been dropped on the way


def _need(env: MatchRegions, drawn: Plan, state: State) -> Float[Array, "B"]:
    """Distance of each block from where it may stay; all zero when the task is solved."""
    goal, blocks = state.data.goal, state.data.pose[-len(env.blocks) :, :2]
    rim = goal[2:] / 2 - jnp.abs(blocks - goal[:2])  # to the nearer sides; negative beyond
    depth = rim.min(axis=1)
    outside = jnp.where(depth < _EDGE, length(jnp.maximum(_EDGE - rim, 0.0)), 0.0)
    inside = 1.5 * jnp.maximum(depth + _OUT, 0.0)
    target = jnp.arange(len(blocks)) < env.num_targets
    solved = jnp.where(target, depth > _SAFE, depth < -_SAFE).all()
    solving = jnp.where(solved, 0.0, jnp.where(target, outside, inside))
    away = jnp.maximum(length(blocks[drawn.blocks] - drawn.slots) - _CLOSE, 0.0)
    failing = jnp.zeros(len(blocks)).at[drawn.blocks].set(away)
    return jnp.where(drawn.retry, solving, failing)


def cost(env: MatchRegions, drawn: Plan, state: State, pull: Pull) -> Float[Array, ""]:
    """The cost of what is left to do, arena units; 0 when all is done and nothing pulls."""
    need, robot = _need(env, drawn, state), state.data.pose[0, :2]
    blocks, todo = state.data.pose[-len(env.blocks) :, :2], need > 0
    # At a wall, or beside another block, a block is hard to get behind.
    tight = 1.5 * jnp.maximum(jnp.abs(blocks) - (env.arena - _ROOM), 0.0).sum(axis=1)
    gaps = length(blocks[:, None] - blocks) + 10.0 * jnp.eye(len(blocks))
    tight += jnp.maximum(_ROOM - gaps, 0.0).sum(axis=1)
    tight *= jnp.arange(len(blocks)) < env.num_targets
    block = blocks[jnp.argmin(jnp.where(todo, length(blocks - robot), 10.0))]
    way = state.data.goal[:2] - block
    near = 0.1 * length(robot - (block - 0.25 * way / length(way))) * todo.any()
    near = jnp.where(pull.weight > 0, pull.weight * length(robot - pull.point), near)
    return jnp.where(todo, need + 0.2 + tight, 0.0).sum() + near


def _draw(env: MatchRegions, drawn: Plan, key: PRNGKeyArray, state: State) -> Route:
    """Samples a random route for a random block that is not where it should be."""
    key_block, key_slot, key_route = jax.random.split(key, 3)
    goal, blocks = state.data.goal, state.data.pose[-len(env.blocks) :, :2]
    todo = _need(env, drawn, state) > 0
    which = jax.random.categorical(key_block, jnp.log(jnp.where(todo, 1.0, 0.05)))
    block = blocks[which]
    reach = jnp.maximum(goal[2:] / 2 - 0.08, 0.0)
    slot = goal[:2] + reach * jax.random.uniform(key_slot, (2,), minval=-1.0)
    off = block - goal[:2]
    slot = jnp.where(which < env.num_targets, slot, block + 0.3 * off / length(off))
    planned = drawn.slots[jnp.argmax(drawn.blocks == which)]
    return routes.draw(
        env, key_route, state.data.pose[0, :2], block, jnp.where(drawn.retry, slot, planned)
    )


def _drive(
    env: MatchRegions, drawn: Plan, state: State, route: Route
) -> tuple[Float[Array, "2"], Route]:
    """The action along the route (zero when all is done), and the updated route."""
    action, route = routes.follow(env, route, state)
    return jnp.where((_need(env, drawn, state) > 0).any(), action, 0.0), route


def _outlook(
    env: MatchRegions, how: Search, drawn: Plan, state: State, pull: Pull, route: Route
) -> Float[Array, ""]:
    """The cost of a route: that at the horizon, and on average, so that sooner is better."""

    def move(carry, _):
        state, route = carry
        action, route = _drive(env, drawn, state, route)
        state = env.step(state, action)
        return (state, route), cost(env, drawn, state, pull)

    _, costs = jax.lax.scan(move, (state, route), length=how.horizon)
    return 0.7 * costs[-1] + 0.3 * costs.mean()


def _vary(how: Search, key: PRNGKeyArray, best: Route, new: Route) -> Route:
    """The routes of a later round: the best with noise, and a quarter of new ones."""
    key_pick, key_noise = jax.random.split(key)
    pick = jax.random.randint(key_pick, (how.candidates,), 0, how.elite)
    varied = jax.tree.map(lambda x: x[pick], best)
    noise = _NOISE * jax.random.normal(key_noise, varied.points.shape)
    varied = varied._replace(points=varied.points + noise)
    fresh = how.candidates // 4
    return jax.tree.map(lambda x, y: x.at[:fresh].set(y[:fresh]), varied, new)


def search(
    env: MatchRegions,
    how: Search,
    drawn: Plan,
    key: PRNGKeyArray,
    state: State,
    held: Route,
    pull: Pull,
) -> Route:
    """The best route found; at least as good as the current one, or as standing still."""

    def improve(carry, key):
        best, costs = carry
        key_new, key_vary = jax.random.split(key)
        keys = jax.random.split(key_new, how.candidates)
        new = jax.vmap(lambda k: _draw(env, drawn, k, state))(keys)
        first = jax.tree.map(lambda x, a, b: x.at[0].set(a).at[1].set(b), new, routes.stay(), held)
        later = _vary(how, key_vary, best, new)
        begins = costs[-1] > 0.5 * _NONE
        tried = jax.tree.map(lambda a, b: jnp.where(begins, a, b), first, later)
        outlook = jax.vmap(lambda route: _outlook(env, how, drawn, state, pull, route))(tried)
        pool = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), best, tried)
        costs = jnp.concatenate([costs, outlook])
        order = jnp.argsort(costs)[: how.elite]
        return (jax.tree.map(lambda x: x[order], pool), costs[order]), None

    none = jax.tree.map(lambda x: jnp.stack([x] * how.elite), routes.stay())
    begin = none, jnp.full(how.elite, _NONE)
    (best, _), _ = jax.lax.scan(improve, begin, jax.random.split(key, how.rounds))
    return jax.tree.map(lambda x: x[0], best)


def _think(
    env: MatchRegions, how: Search, drawn: Plan, key: PRNGKeyArray, state: State, memory: _Memory
) -> _Memory:
    """Searches for a route, towards the plan's detour or a random place if need be."""
    key_whim, key_search = jax.random.split(key)
    now = cost(env, drawn, state, Pull(jnp.zeros(2), jnp.zeros(())))
    whim = (now > memory.cost - _GAIN) & ~memory.whim & (now > 0)
    at = jnp.minimum(memory.stage, len(drawn.blocks) - 1)
    roams = memory.time < memory.since + drawn.pauses[at] + drawn.via_steps[at]
    anywhere = (env.arena - 0.15) * jax.random.uniform(key_whim, (2,), minval=-1.0)
    pull = Pull(jnp.where(roams, drawn.via[at], anywhere), jnp.where(roams | whim, 0.3, 0.0))
    route = search(env, how, drawn, key_search, state, memory.route, pull)
    return memory._replace(route=route, cost=now, whim=whim)


def _act(
    env: MatchRegions, drawn: Plan, state: State, memory: _Memory
) -> tuple[Float[Array, "2"], _Memory]:
    """The action for this step, and the updated memory."""
    last, need = len(drawn.blocks) - 1, _need(env, drawn, state)
    todo = need[drawn.blocks] > 0
    stage = jnp.where(todo.any(), jnp.argmax(todo), jnp.where((need > 0).any(), last, last + 1))
    since = jnp.where(stage != memory.stage, memory.time, memory.since)
    # A block to be dropped is let go half-way.
    half = 0.5 * state.data.start_distance[jnp.minimum(drawn.blocks[-1], env.num_targets - 1)]
    drops = drawn.drop < env.episode_length
    over = memory.over | drops & (stage == last) & (need[drawn.blocks[-1]] < half)
    pause = memory.time < since + drawn.pauses[jnp.minimum(stage, last)]
    rest = over | pause | (memory.time >= drawn.steps)
    action, route = _drive(env, drawn, state, memory.route)
    route = jax.tree.map(lambda a, b: jnp.where(rest, a, b), memory.route, route)
    return jnp.where(rest, 0.0, action), memory._replace(
        route=route, stage=stage.astype(jnp.int32), since=since, time=memory.time + 1, over=over
    )


def play(
    env: MatchRegions, key: PRNGKeyArray, state: State, drawn: Plan, how: Search
) -> tuple[State, Int[Array, "T"]]:
    """Plays the rest of an episode: the states of T more steps, and the plan's stage at each."""
    zero = jnp.zeros((), jnp.int32)
    memory = _Memory(routes.stay(), jnp.float32(_NONE), zero > 0, zero, zero, zero, zero > 0)

    def stride(carry, key):
        state, memory = carry

        def move(carry, _):
            state, memory = carry
            action, memory = _act(env, drawn, state, memory)
            state = env.step(state, action)
            return (state, memory), (state, memory.stage)

        memory = _think(env, how, drawn, key, state, memory)
        return jax.lax.scan(move, (state, memory), length=how.stride)

    searches = -(-env.episode_length // how.stride)
    _, played = jax.lax.scan(stride, (state, memory), jax.random.split(key, searches))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[: env.episode_length], played)
