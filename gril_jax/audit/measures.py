"""Audit of a reward: does it order states by true progress, and is it low without success?

    states = jax.vmap(partial(make_states, task=env.stages))(keys, starts)  # once for all rewards
    one = lambda params: audit(reward, params, key, env.stages, states).measures
    measures = jax.jit(jax.vmap(one))(many_params)

Everything is pure: jit it, and map it over the parameters of many rewards. "Range" is the reward of
success less that of the reset. Shares are shares of the start's own range. Successes and shortfalls
are the clear ones (`gril_jax.audit.shortfalls`), if nothing else is said.

Shapes use B for starts, S for the states of a battery, V for successes that are followed uphill, F
for factors, K for kinds of shortfall, M for objects that can move and A for searches.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .ascent import Found, kept, search
from .made import Rewards, States, rewards_of
from .scene_reward import SceneReward, StagedTask
from .shortfalls import KINDS
from .states import FACTORS, SUCCESS, Battery


class Measures(NamedTuple):
    """The audit of one reward. Indices point into the arrays of `States` and `Found`."""

    order_accuracy: Float[Array, ""]  # share of pairs with the higher reward further on
    factor_accuracy: Float[Array, "F"]  # the same by factor; NaN where there is no pair
    worst_violation: Float[Array, ""]  # how much higher the lesser state of a pair is; a share
    worst_pair: Int[Array, "3"]  # start, the lesser state, the better state
    hack_gap: Float[Array, ""]  # worst success less best state without progress; reward units
    misranked: Float[Array, "K"]  # share of sampled successes not above the best state of a kind
    misranked_share: Float[Array, ""]  # that of the worst kind
    success_kept: Float[Array, ""]  # share of successes from which the reward leads to a success
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
    found: Found  # leading axes B, A, K


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

    def one(key, start, ends):
        found = search(reward, params, key, task, start, ascents=-(-ascents // count), steps=steps)
        return found, kept(reward, params, task, start, ends)

    ends = jax.vmap(lambda made, which: jax.tree.map(lambda x: x[which], made))(
        states.successes, states.followed
    )
    found, stays = jax.lax.map(lambda x: one(*x), (jax.random.split(key, count), begins, ends))
    rewards = rewards_of(reward, params, states)
    return Audit(measure(rewards, states, found, stays), rewards, found)


def measure(rewards: Rewards, states: States, found: Found, stays: Bool[Array, "B V"]) -> Measures:
    """The measures, from the states' rewards, the searches (leading B, A, K), and which of the
    states to follow the reward keeps (`ascent.kept`)."""
    made, paid = states.battery, rewards.battery
    kind = made.factor[0]  # every start has the same factors
    reset = paid[:, 0]
    plain = (made.score >= SUCCESS) & (kind == FACTORS.index("success"))
    counted = jnp.sum(plain, axis=1).astype(paid.dtype)
    span = jnp.sum(jnp.where(plain, paid, 0.0), axis=1) / counted - reset
    unit = jnp.where(span > 0, span, jnp.nan)  # a reward that is lower for success has no range

    def share(x):
        """The value as a share of each start's own range."""
        lead = (-1, *[1] * (x.ndim - 1))
        return (x - reset.reshape(lead)) / unit.reshape(lead)

    unearned, best = _bests(rewards, states, found)
    worst = jnp.minimum(
        jnp.min(paid, where=plain | states.clear, initial=jnp.inf),
        jnp.min(rewards.successes, where=states.succeeds, initial=jnp.inf),
    )
    below = states.succeeds[..., None] & ~(rewards.successes[..., None] > best)
    misranked = below.sum((0, 1)) / states.succeeds.sum()
    misranked = jnp.where(best == -jnp.inf, jnp.nan, misranked)
    tried = jnp.take_along_axis(states.succeeds, states.followed, axis=1)
    at_start = (made.scenes.center == made.scenes.center[:, :1]).all(axis=(2, 3))
    touched = (kind == FACTORS.index("touched")) & at_start
    in_any_way = lambda values, where, axis=None: jnp.max(  # noqa: E731
        share(values), where=where, initial=-jnp.inf, axis=axis
    )
    met = found.reward != -jnp.inf
    finite = [*map(jnp.isfinite, rewards), jnp.isfinite(found.reward) | ~met]
    return Measures(
        **_order(made, paid, unit),
        hack_gap=worst - unearned,
        misranked=misranked,
        misranked_share=jnp.nanmax(misranked),
        success_kept=jnp.sum(stays & tried) / jnp.sum(tried),
        hack_share=(unearned - jnp.mean(reset)) / jnp.mean(unit),
        range=jnp.mean(span),
        start_reward=jnp.mean(reset),
        worst_success=worst,
        best_unearned=unearned,
        touch_share=in_any_way(paid, touched),
        push_share=in_any_way(rewards.pushed, states.pushed.nothing),
        alone_share=in_any_way(rewards.alone, states.alone.nothing, (0, 1, 3, 4)),
        finite=jnp.stack([x.all() for x in finite]).all(),
    )


def _bests(rewards, states, found) -> tuple[Float[Array, ""], Float[Array, "K"]]:
    """The highest reward without progress, and that of each kind of shortfall."""
    most = functools.partial(jnp.max, initial=-jnp.inf)
    unearned = [most(found.reward, where=found.score <= 0)]
    kinds = [most(found.reward, axis=(0, 1))]
    for paid, made in zip(rewards, states.judged(), strict=False):
        unearned.append(most(paid, where=made.nothing))
        each = made.kind[..., None] == jnp.arange(len(KINDS))
        kinds.append(most(paid[..., None], where=each, axis=tuple(range(paid.ndim))))
    return jnp.stack(unearned).max(), jnp.stack(kinds).max(axis=0)


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
