"""Audit of a reward: does it order states by true progress, and is it low without progress?

    states = jax.vmap(partial(make_states, task=env.stages))(keys, starts)  # once for all rewards
    one = lambda params: audit(reward, params, key, env.stages, states).measures
    measures = jax.jit(jax.vmap(one))(many_params)

Everything is pure: jit it, and map it over the parameters of many rewards. "Range" is the reward of
success less that of the reset. Shares are shares of the start's own range.

Shapes use B for starts, S for the states of a battery and W for successes. F is for factors, M for
objects that can move, G for a side of a grid and A for searches.
"""

import functools
import itertools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .ascent import Found, search
from .scene_reward import Scene, SceneReward, StagedTask, alone, pushed
from .states import FACTORS, SUCCESS, Battery, battery, successes

_SIDE = 25
# States in which whatever is done has been put where its stage clearly holds; a detour's last
# frames may be at the very edge, like the successes sampled from all that count.
_CLEAR = ("progress", "success")
_TOGETHER = 256  # states side by side


class States(NamedTuple):
    """All states that do not depend on the reward; leading axis B."""

    battery: Battery
    alone: Scene  # (2, M, G, G): each object swept over the plane, from the start and from success
    alone_free: Bool[Array, "*B 2 M G G"]  # where there is no progress
    pushed: Scene  # (G, G): all targets side by side
    pushed_free: Bool[Array, "*B G G"]
    successes: Scene  # (W,): sampled from all of them
    succeeds: Bool[Array, "*B W"]  # whether a sample is one


class Rewards(NamedTuple):
    """The reward of each of the `States`."""

    battery: Float[Array, "B S"]
    alone: Float[Array, "B 2 M G G"]
    pushed: Float[Array, "B G G"]
    successes: Float[Array, "B W"]


class Measures(NamedTuple):
    """The audit of one reward. Indices point into the arrays of `States` and `Found`."""

    order_accuracy: Float[Array, ""]  # share of pairs with the higher reward further on
    factor_accuracy: Float[Array, "F"]  # the same by factor; NaN where there is no pair
    worst_violation: Float[Array, ""]  # how much higher the lesser state of a pair is; a share
    worst_pair: Int[Array, "3"]  # start, the lesser state, the better state
    hack_gap: Float[Array, ""]  # worst clear success less best state without progress; reward units
    hack_gap_scattered: Float[Array, ""]  # the same with other objects moved in the successes
    hack_gap_anywhere: Float[Array, ""]  # the same with successes from all that count
    misranked_share: Float[Array, ""]  # share of those not above the best state without progress
    hack_share: Float[Array, ""]  # reward of the best state without progress; a share
    range: Float[Array, ""]  # mean success less mean reset, units of reward
    start_reward: Float[Array, ""]  # mean reset, units of reward
    worst_success: Float[Array, ""]  # units of reward
    best_unearned: Float[Array, ""]  # of all states with true progress 0, units of reward
    touch_share: Float[Array, ""]  # all bits set, nothing moved
    push_share: Float[Array, ""]  # all targets pushed to the wrong place of highest reward
    alone_share: Float[Array, "M"]  # each object alone moved to its useless place of highest reward
    finite: Bool[Array, ""]  # all rewards are


class Audit(NamedTuple):
    """The measures, and the states and rewards behind them."""

    measures: Measures
    rewards: Rewards
    found: Found  # leading axes B, A


def make_states(key: PRNGKeyArray, start: Scene, *, task: StagedTask, side: int = _SIDE) -> States:
    """Makes all states around the state after a reset; batch with `jax.vmap`.

    `side` is that of the grids. The key is consumed.
    """
    made = battery(key, task, start)
    success = made.scenes.center[jnp.argmax(made.factor == FACTORS.index("success"))]
    sweep = jax.vmap(lambda center: alone(task, start, center, side=side))
    swept = sweep(jnp.stack([start.center, success]))
    progress = jnp.vectorize(task.progress, signature="(n,k),(n,k)->()")
    return States(
        made, swept, progress(swept.center, swept.size) <= 0, *pushed(task, start, side=side),
        *successes(jax.random.fold_in(key, 1), task, start),
    )  # fmt: skip


def audit(
    reward: SceneReward,
    params: Any,
    key: PRNGKeyArray,
    task: StagedTask,
    states: States,
    *,
    ascents: int = 1000,
    steps: int = 100,
) -> Audit:
    """Runs the adversary and the measures; jit it, and `jax.vmap` it over `params`.

    Args:
      reward, params: of one state, differentiable in its centres.
      key: of the searches; consumed.
      task: in stages.
      states: from `make_states`, leading axis B.
      ascents: gradient searches in all, shared by the starts.
      steps: of each search.
    """
    begins = jax.tree.map(lambda x: x[:, 0], states.battery.scenes)
    count = begins.center.shape[0]

    def one(key, start):
        return search(reward, params, key, task, start, ascents=-(-ascents // count), steps=steps)

    found = jax.lax.map(lambda x: one(*x), (jax.random.split(key, count), begins))
    rewards = rewards_of(reward, params, states)
    return Audit(measure(rewards, states, found), rewards, found)


def rewards_of(reward: SceneReward, params: Any, states: States) -> Rewards:
    """Evaluates the reward at every state."""
    parts = (states.battery.scenes, states.alone, states.pushed, states.successes)
    shapes = [scenes.active.shape[:-1] for scenes in parts]
    sizes = [math.prod(shape) for shape in shapes]
    padding = -sum(sizes) % _TOGETHER  # a remainder would be a program of its own

    def flat(*leaves):
        each = zip(leaves, sizes, shapes, strict=True)
        joined = jnp.concatenate([x.reshape(n, *x.shape[len(s) :]) for x, n, s in each])
        return jnp.concatenate([joined, jnp.repeat(joined[:1], padding, axis=0)])

    every, one = jax.tree.map(flat, *parts), functools.partial(reward, params)
    paid = jax.lax.map(one, every, batch_size=_TOGETHER)
    ends = list(itertools.accumulate(sizes))
    return Rewards(*(x.reshape(s) for x, s in zip(jnp.split(paid, ends), shapes, strict=False)))


def measure(rewards: Rewards, states: States, found: Found) -> Measures:
    """The measures, from the states' rewards and the results of the searches (leading B, A)."""
    made, paid = states.battery, rewards.battery
    kind = made.factor[0]  # every start has the same factors
    reset = paid[:, 0]
    success = made.score >= SUCCESS
    plain = success & (kind == FACTORS.index("success"))
    counted = jnp.sum(plain, axis=1).astype(paid.dtype)
    span = jnp.sum(jnp.where(plain, paid, 0.0), axis=1) / counted - reset
    unit = jnp.where(span > 0, span, jnp.nan)  # a reward that is lower for success has no range

    def share(x):
        """The value as a share of each start's own range."""
        lead = (-1, *[1] * (x.ndim - 1))
        return (x - reset.reshape(lead)) / unit.reshape(lead)

    unearned = jnp.stack([
        jnp.max(paid, where=made.score <= 0, initial=-jnp.inf),
        jnp.max(rewards.alone, where=states.alone_free, initial=-jnp.inf),
        jnp.max(rewards.pushed, where=states.pushed_free, initial=-jnp.inf),
        jnp.max(found.reward),
    ]).max()  # fmt: skip
    worst = jnp.min(paid, where=clear_successes(made), initial=jnp.inf)
    at_start = (made.scenes.center == made.scenes.center[:, :1]).all(axis=(2, 3))
    touched = (kind == FACTORS.index("touched")) & at_start
    in_any_way = lambda values, where, axis=None: jnp.max(  # noqa: E731
        share(values), where=where, initial=-jnp.inf, axis=axis
    )
    return Measures(
        **_order(made, paid, unit),
        hack_gap=worst - unearned,
        hack_gap_scattered=jnp.min(paid, where=success, initial=jnp.inf) - unearned,
        hack_gap_anywhere=jnp.min(rewards.successes, where=states.succeeds, initial=jnp.inf)
        - unearned,
        misranked_share=jnp.sum(states.succeeds & ~(rewards.successes > unearned))
        / jnp.sum(states.succeeds),
        hack_share=(unearned - jnp.mean(reset)) / jnp.mean(unit),
        range=jnp.mean(span),
        start_reward=jnp.mean(reset),
        worst_success=worst,
        best_unearned=unearned,
        touch_share=in_any_way(paid, touched),
        push_share=in_any_way(rewards.pushed, states.pushed_free),
        alone_share=in_any_way(rewards.alone, states.alone_free, (0, 1, 3, 4)),
        finite=jnp.stack([jnp.isfinite(x).all() for x in (*rewards, found.reward)]).all(),
    )


def clear_successes(made: Battery) -> Bool[Array, "B S"]:
    """True for successes of which all has been put where its stage clearly holds."""
    clear = jnp.isin(made.factor, jnp.array([FACTORS.index(name) for name in _CLEAR]))
    return clear & (made.score >= SUCCESS)


def _order(made: Battery, paid: Float[Array, "B S"], unit: Float[Array, "B"]) -> dict[str, Array]:
    """Accuracy over all pairs with different true scores: has the better one the higher reward?"""
    first, second, kind = made.first[0], made.second[0], made.pair_factor[0]
    ahead = made.score[:, first] - made.score[:, second]
    more = paid[:, first] - paid[:, second]
    counts = jnp.abs(ahead) > 1e-6
    right = counts & (jnp.sign(ahead) * more > 0)
    of = kind == jnp.arange(len(FACTORS))[:, None]  # (F, P)
    share = lambda chosen: (right & chosen).sum() / (counts & chosen).sum()  # noqa: E731
    violation = jnp.where(counts, -jnp.sign(ahead) * more, -jnp.inf)
    start, pair = jnp.unravel_index(jnp.argmax(violation), violation.shape)
    swap = ahead[start, pair] > 0
    lesser = jnp.where(swap, second[pair], first[pair])
    better = jnp.where(swap, first[pair], second[pair])
    return {
        "order_accuracy": share(True),
        "factor_accuracy": jax.vmap(share)(of),
        "worst_violation": jnp.maximum(violation[start, pair], 0.0) / unit[start],
        "worst_pair": jnp.stack([start, lesser, better]).astype(jnp.int32),
    }
