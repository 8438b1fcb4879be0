"""GAIL: a discriminator beside PPO, and a task with MAGICAL's actions alone."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.experiments.baselines import cloning
from gril_jax.experiments.baselines.gail import Discrete, Expert, Gail, Options, configured
from support.probes import Probe

from gril_jax import envs
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.files import write_demo_set
from gril_jax.errors import DemoError
from gril_jax.rl.ppo import PPO, Hyper, Static
from gril_jax.rl.rewards import environmental

STATIC = Static(
    num_envs=16, unroll_length=8, num_minibatches=2, num_epochs=4, hidden=(16,), window=4,
    observe_activity=False,
)  # fmt: skip
HYPER = Hyper(*map(jnp.float32, Hyper(learning_rate=5e-3, discounting=0.5)))


class Signed(Probe):
    """The probe, whose actions are signs."""

    nearest = staticmethod(jnp.sign)


@pytest.fixture(scope="module")
def learned():
    """A learner after 60 steps of imitating an expert who answers each sign with its opposite."""
    sign = np.random.default_rng(0).choice([-1.0, 1.0], 64).astype(np.float32)
    obs = np.stack([sign, np.zeros_like(sign)], axis=1)
    expert = Expert(*map(jnp.asarray, (obs, -sign[:, None], np.zeros(2, "f"), np.ones(2, "f"))))
    gail = Gail(PPO(Signed(), environmental, STATIC), expert, updates=4, learning_rate=1e-3)
    state, step = gail.init(jax.random.key(0), HYPER), jax.jit(gail.step)
    metrics = []
    for _ in range(60):
        state, found = step(state, HYPER, ())
        metrics.append(jax.device_get(found))
    return gail, state, metrics


def test_the_policy_does_as_the_expert_and_not_as_the_task_would_pay(learned):
    _, _, metrics = learned
    success = [float(m["success"]) for m in metrics]  # of answering with the same sign
    assert np.mean(success[:5]) > 0.3
    assert np.mean(success[-10:]) < 0.1


def test_at_first_the_discriminator_tells_both_apart_and_in_the_end_it_cannot(learned):
    apart = [float(m["told_apart"]) for m in learned[2]]
    assert max(apart[:20]) > 0.58
    assert np.mean(apart[-10:]) < 0.55


def test_the_same_key_brings_the_same_weights(learned):
    gail, _, _ = learned
    step = jax.jit(gail.step)
    one, other = (step(gail.init(jax.random.key(3), HYPER), HYPER, ())[0] for _ in range(2))
    for a, b in zip(jax.tree.leaves(one.weights), jax.tree.leaves(other.weights), strict=True):
        np.testing.assert_array_equal(a, b)


def test_actions_are_the_nearest_of_magicals():
    env = envs.make("move_to_region", padded=True)
    discrete, known = Discrete(env), np.asarray(cloning.table())
    assert discrete.action_size == env.action_size
    aside = jnp.asarray(known) + jax.random.uniform(
        jax.random.key(0), known.shape, minval=-0.3, maxval=0.3
    )
    np.testing.assert_array_equal(discrete.nearest(aside), known)
    state = env.reset(jax.random.key(0))
    ours, theirs = (
        jax.jit(discrete.step)(state, aside[6]),
        jax.jit(env.step)(state, jnp.asarray(known[6])),
    )
    np.testing.assert_array_equal(ours.obs, theirs.obs)


def test_films_give_starts_in_demo_and_in_no_variant():
    options = Options(Path("recorded.json"), Path("sets"), Path("out.json"), num_timesteps=200_000)
    demo = configured("find_dupe", options)
    everywhere = configured("find_dupe", dataclasses.replace(options, variant="all"))
    assert (demo.env.variant, everywhere.env.variant) == ("demo", "all")
    assert demo.ppo.video_state_resets > 0
    assert everywhere.ppo.video_state_resets == everywhere.ppo.visited_state_resets == 0
    for config in (demo, everywhere):
        assert (config.run.reward, config.ppo.num_timesteps) == ("environmental", 200_000)
        assert config.ppo.observe_activity is False


# --- Pairs of observations and recorded actions

ACTIONS = np.array([6, 6, 1, 1, 1, 0], np.int32)


@pytest.fixture(scope="module")
def driven():
    """The task, the observations in which each of the actions was chosen, and the boxes there."""
    env = envs.make("find_dupe", padded=True)
    state, states = env.reset(jax.random.key(0)), []
    step = jax.jit(env.step)
    for action in ACTIONS:
        states.append(state)
        state = step(state, cloning.table()[action])
    return env, *jax.tree.map(lambda *x: np.stack(x), *[(s.obs, s.objects) for s in states])


@pytest.fixture
def film(driven, tmp_path):
    """A demonstration set of that one video, whose objects are in another order, but for twins."""
    env, _, seen = driven
    there = np.flatnonzero(seen.size[0].any(axis=1))
    there = there[np.argsort(-seen.label[0, there], kind="stable")]
    tracks = Tracks(
        seen.center[:, there], seen.size[:, there], seen.label[0, there],
        np.ones((len(ACTIONS), len(there)), bool),
    )  # fmt: skip
    write_demo_set(
        tmp_path / "set", [Demo("film-000", np.zeros((6, 16, 16, 3), np.uint8), tracks)],
        task="find_dupe", classes=env.classes, half_extent=1.0, fps=8.0, source="made up",
    )  # fmt: skip
    return tmp_path / "set"


def test_what_our_simulator_did_itself_is_observed_again(driven):
    env, own, seen = driven
    films = [seen.center, seen.center[:4]]
    obs, chosen = cloning.pairs(env, films, [ACTIONS, ACTIONS[:4]])
    assert chosen.tolist() == [*ACTIONS, *ACTIONS[:4]]
    np.testing.assert_allclose(obs, np.concatenate([own, own[:4]]), atol=1e-3)


def test_objects_of_a_film_are_put_in_the_order_of_the_task(driven, film):
    env, own, _ = driven
    assert len(load_demo_set(film)) == 1
    obs, chosen = cloning.of_task(env, ACTIONS[None], film)
    assert chosen.tolist() == ACTIONS.tolist()
    np.testing.assert_allclose(obs, own, atol=1e-3)


def test_films_and_actions_must_be_as_many(driven, film):
    with pytest.raises(DemoError, match="has 1 videos, but there are recorded actions of 2"):
        cloning.of_task(driven[0], np.stack([ACTIONS, ACTIONS]), film)
