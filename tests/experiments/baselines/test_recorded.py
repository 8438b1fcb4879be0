"""Pairs of observations and recorded actions."""

import jax
import numpy as np
import pytest
from gril_jax.experiments.baselines import recorded

from gril_jax import envs
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.files import write_demo_set
from gril_jax.errors import DemoError

ACTIONS = np.array([6, 6, 1, 1, 1, 0], np.int32)


@pytest.fixture(scope="module")
def driven():
    """The task, the observations in which each of the actions was chosen, and the boxes there."""
    env = envs.make("find_dupe", padded=True)
    state, states = env.reset(jax.random.key(0)), []
    step = jax.jit(env.step)
    for action in ACTIONS:
        states.append(state)
        state = step(state, recorded.table()[action])
    return env, *jax.tree.map(lambda *x: np.stack(x), *[(s.obs, s.objects) for s in states])


@pytest.fixture
def film(driven, tmp_path):
    """A demonstration set of that one film, whose objects are in another order, but for twins."""
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
    obs, chosen = recorded.pairs(env, films, [ACTIONS, ACTIONS[:4]])
    assert chosen.tolist() == [*ACTIONS, *ACTIONS[:4]]
    np.testing.assert_allclose(obs, np.concatenate([own, own[:4]]), atol=1e-3)


def test_objects_of_a_film_are_put_in_the_order_of_the_task(driven, film):
    env, own, _ = driven
    assert len(load_demo_set(film)) == 1
    obs, chosen = recorded.of_task(env, ACTIONS[None], film)
    assert chosen.tolist() == ACTIONS.tolist()
    np.testing.assert_allclose(obs, own, atol=1e-3)


def test_films_and_actions_must_be_as_many(driven, film):
    with pytest.raises(DemoError, match="has 1 films, but there are recorded actions of 2"):
        recorded.of_task(driven[0], np.stack([ACTIONS, ACTIONS]), film)
