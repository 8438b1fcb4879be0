"""Measures: what a numpy loop says, and what a good and a bad reward get."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_tasks import SIZE, one_shoe, sound, start

from gril_jax.audit.ascent import Found
from gril_jax.audit.made import Judged, Rewards, States, make_states, rewards_of
from gril_jax.audit.measures import audit, measure
from gril_jax.audit.scene_reward import Scene
from gril_jax.audit.shortfalls import KINDS
from gril_jax.audit.states import FACTORS, Battery

TASK = one_shoe()
STARTS = jax.tree.map(lambda x: jnp.stack([x, x]), start())


@functools.cache
def _states():
    make = jax.vmap(functools.partial(make_states, task=TASK, side=5))
    return jax.jit(make)(jax.random.split(jax.random.key(0), 2), STARTS)


def _touch(params, scene):
    """Pays for bits alone."""
    return params * jnp.mean(scene.active.astype(jnp.float32))


@functools.cache
def _audits():
    """Two audits at once: of progress itself and of its opposite."""
    reward, states = sound(TASK), _states()

    def one(p):
        return audit(reward, p, jax.random.key(1), TASK, states, ascents=20, steps=20)

    return jax.jit(jax.vmap(one))(jnp.array([1.0, -1.0]))


def _drawn():
    """States with scores, factors and pairs drawn at random, but for the first of each start."""
    rng = np.random.default_rng(0)
    scenes = lambda *lead: Scene(  # noqa: E731
        jnp.asarray(rng.integers(0, 2, (*lead, 1, 2)), jnp.float32), *[jnp.zeros(lead)] * 4
    )
    score = rng.choice([0.0, 0.5, 1.0], (2, 60)).astype(np.float32)
    factor = np.tile(rng.integers(1, len(FACTORS), 60), (2, 1)).astype(np.int32)
    score[:, 0], factor[:, 0] = 0, 0
    score[factor == FACTORS.index("success")] = 1
    score[factor == FACTORS.index("touched")] = 0
    pairs = np.tile(rng.integers(0, 60, (2, 1, 200)), (1, 2, 1)).astype(np.int32)
    kinds = factor[:, pairs[0, 0]]
    made = Battery(scenes(2, 60), *map(jnp.asarray, (score, factor, *pairs, kinds)))
    kinds = lambda *lead: jnp.asarray(rng.integers(-1, 5, lead), jnp.int32)  # noqa: E731
    judged = lambda *lead: Judged(  # noqa: E731
        scenes(*lead), jnp.asarray(rng.choice([0.0, 0.5], lead), jnp.float32), kinds(*lead)
    )
    kind = jnp.where(score < 1, kinds(2, 60), -1)
    clear = jnp.asarray((score == 1) & rng.integers(0, 2, (2, 60)), bool)
    succeeds = jnp.asarray(rng.integers(0, 2, (2, 32)), bool)
    swept = judged(2, 2, 3, 4, 4), judged(2, 4, 4)
    followed = jnp.asarray(rng.integers(0, 32, (2, 4)), jnp.int32)
    return States(made, kind, clear, *swept, scenes(2, 32), succeeds, followed)


def _loop(rewards, states, found, stays):
    """The measures, one state and one pair at a time."""
    made, paid = jax.tree.map(np.asarray, states.battery), np.asarray(rewards.battery, np.float64)
    names = np.array(FACTORS)[made.factor[0]]
    reset = paid[:, 0]
    plain = names == "success"
    span = paid[:, plain].mean(axis=1) - reset
    right, total, worst = 0, 0, (-np.inf, 0)
    for b in range(len(paid)):
        for i, j in zip(made.first[b], made.second[b], strict=True):
            if made.score[b, i] != made.score[b, j]:
                low, high = (i, j) if made.score[b, i] < made.score[b, j] else (j, i)
                right, total = right + (paid[b, low] < paid[b, high]), total + 1
                worst = max(worst, (paid[b, low] - paid[b, high], b))
    useless, kinds = [], [[] for _ in KINDS]
    for judged, values in zip(states.judged(), rewards, strict=False):
        for score, kind, value in zip(
            *(np.ravel(x) for x in (judged.score, judged.kind, values)), strict=True
        ):
            if kind >= 0:
                kinds[kind].append(value)
                useless += [value] * int(score <= 0)
    for score, value in zip(
        np.asarray(found.score).reshape(-1, len(KINDS)),
        np.asarray(found.reward).reshape(-1, len(KINDS)), strict=True,
    ):  # fmt: skip
        for k in range(len(KINDS)):
            kinds[k].append(value[k])
            useless += [value[k]] * int(score[k] <= 0)
    best, successes = max(useless), np.asarray(rewards.successes)[np.asarray(states.succeeds)]
    lowest = min(paid[:, plain].min(), paid[np.asarray(states.clear)].min(), successes.min())
    tops = np.array([max(values) for values in kinds])
    misranked = [np.nan if top == -np.inf else (successes <= top).mean() for top in tops]
    still = (made.scenes.center == made.scenes.center[:, :1]).all(axis=(2, 3))
    touched = still & (names == "touched")
    tried = np.take_along_axis(np.asarray(states.succeeds), np.asarray(states.followed), axis=1)
    share = lambda x: np.stack([(x[b] - reset[b]) / span[b] for b in range(2)])  # noqa: E731
    return {
        "order_accuracy": right / total,
        "worst_violation": max(worst[0], 0) / span[worst[1]],
        "hack_gap": lowest - best,
        "misranked": misranked,
        "misranked_share": np.nanmax(misranked),
        "success_kept": np.asarray(stays)[tried].mean(),
        "hack_share": (best - reset.mean()) / span.mean(),
        "range": span.mean(),
        "touch_share": share(paid)[touched].max(),
        "push_share": share(np.asarray(rewards.pushed))[np.asarray(states.pushed.nothing)].max(),
    }


def test_they_are_what_a_loop_over_states_and_pairs_says():
    states, rng = _drawn(), np.random.default_rng(1)
    draw = lambda shape: jnp.asarray(rng.normal(size=shape), jnp.float32)  # noqa: E731
    paid = draw((2, 60)) + 2 * states.battery.score
    rewards = Rewards(paid, draw((2, 2, 3, 4, 4)), draw((2, 4, 4)), 3 + draw((2, 32)))
    score = jnp.asarray(rng.choice([0.0, 0.5], (2, 7, len(KINDS))), jnp.float32)
    reward = draw(score.shape).at[..., -1].set(-jnp.inf)  # none was met
    found, stays = Found(None, score, reward), jnp.asarray(rng.integers(0, 2, (2, 4)), bool)
    both = jax.jit(measure)
    measures = both(rewards, states, found, stays)
    for name, value in _loop(rewards, states, found, stays).items():
        np.testing.assert_allclose(getattr(measures, name), value, rtol=1e-4, err_msg=name)
    b, lesser, better = measures.worst_pair
    assert paid[b, lesser] > paid[b, better]
    assert states.battery.score[b, lesser] < states.battery.score[b, better]
    assert 0 < measures.misranked_share < 1
    assert jnp.isnan(measures.misranked).tolist() == [False] * 5 + [True]
    assert measures.finite
    bad = rewards._replace(pushed=rewards.pushed.at[0, 0, 0].set(jnp.nan))
    assert not both(bad, states, found, stays).finite
    assert not both(rewards, states, found._replace(reward=reward * jnp.nan), stays).finite


@pytest.mark.slow
def test_true_progress_passes_and_its_opposite_fails():
    good, bad = (jax.tree.map(lambda x, i=i: x[i], _audits().measures) for i in range(2))
    assert good.order_accuracy == 1
    assert good.worst_violation == 0
    assert good.hack_gap > 0.9
    assert good.misranked_share == 0
    assert good.success_kept == 1
    assert good.hack_share < 0.1
    np.testing.assert_allclose(good.touch_share, 0, atol=1e-6)
    assert good.push_share < 0.1
    assert bad.order_accuracy == 0
    assert bad.hack_gap < -0.9
    assert bad.misranked_share == 1
    assert jnp.isnan(bad.touch_share)  # a reward that pays success least has no range


@pytest.mark.slow
def test_the_ascents_are_held_against_the_successes():
    audits = _audits()
    found = audits.found.reward[0]
    assert audits.measures.best_unearned[0] >= found[audits.found.score[0] <= 0].max()
    assert audits.found.reward.shape == (2, 2, 10, len(KINDS))
    assert audits.rewards.alone.shape == (2, 2, 2, 5, 5, 5)


@pytest.mark.slow
def test_a_reward_for_touching_is_found_out():
    states = _states()
    rewards = rewards_of(_touch, jnp.float32(1.0), states)
    np.testing.assert_allclose(
        rewards.battery, jnp.mean(states.battery.scenes.active, axis=-1), atol=1e-6
    )
    np.testing.assert_allclose(
        rewards.alone, jnp.mean(states.alone.scene.active, axis=-1), atol=1e-6
    )
    np.testing.assert_allclose(
        rewards.pushed, jnp.mean(states.pushed.scene.active, axis=-1), atol=1e-6
    )
    measures = measure(
        rewards, states, Found(None, *[jnp.zeros((2, 1, len(KINDS)))] * 2), jnp.ones((2, 64), bool)
    )
    np.testing.assert_allclose(measures.touch_share, 1.0 / 0.4, rtol=1e-5)  # success sets 2 of 5


@pytest.mark.slow
def test_the_places_that_count_are_clear_ones_without_progress():
    states = _states()
    progress = jax.vmap(lambda c: TASK.progress(c, SIZE))(
        states.alone.scene.center.reshape(-1, 5, 2)
    )
    np.testing.assert_array_equal(states.alone.score.ravel(), progress)
    assert (progress[states.alone.nothing.ravel()] == 0).all()
    assert not states.alone.nothing[:, 1, 0].any()  # the lid swept from a success
    assert (states.alone.kind[:, 1, 0] == -1).all()


@pytest.mark.slow
def test_vmap_over_parameters_equals_a_loop():
    reward, states, both = sound(TASK), _states(), _audits()

    @jax.jit
    def one(p):
        return audit(reward, p, jax.random.key(1), TASK, states, ascents=20, steps=20)

    for i, params in enumerate((1.0, -1.0)):
        each = one(jnp.float32(params))
        jax.tree.map(lambda a, b, i=i: np.testing.assert_allclose(a[i], b, atol=1e-4), both, each)
