"""The choice of states: by a plain loop over episodes, and by what must never be chosen."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.audit.scene_reward import Scene
from gril_jax.pretraining import hard_negatives
from gril_jax.pretraining.final_places import FinalPlaces, misplacement

EPISODES, FRAMES, OBJECTS = 4, 30, 3
OPTIONS = {"every": 4, "apart": 0.1, "ended": 0.1, "least": 0.05}


def _scenes(key=0):
    """Wandering objects; the second episode repeats the first."""
    keys = jax.random.split(jax.random.key(key), 2)
    center = jnp.cumsum(0.1 * jax.random.normal(keys[0], (EPISODES, FRAMES, OBJECTS, 2)), axis=1)
    center = center.at[1].set(center[0])
    active = jnp.broadcast_to(jnp.arange(FRAMES)[:, None] > 3, (EPISODES, FRAMES, OBJECTS))
    label = jnp.broadcast_to(jnp.arange(OBJECTS), active.shape)
    return Scene(center, jnp.full(center.shape, 0.2), label, label == 1, active)


@pytest.fixture(scope="module")
def scenes():
    return _scenes()


@pytest.fixture(scope="module")
def rewards():
    """Rewards paid and due: the third episode ends well, and one moment is no number."""
    paid, due = np.random.default_rng(0).uniform(-1, 0, (2, EPISODES, FRAMES)).astype(np.float32)
    due[:, -1] = -0.5
    due[2, -1] = -0.05
    paid[3, 7] = np.nan
    return jnp.asarray(paid), jnp.asarray(due)


@pytest.fixture(scope="module")
def chosen(scenes, rewards):
    found = hard_negatives.choose(scenes, *rewards, num=40, **OPTIONS)
    return jax.tree.map(np.asarray, found)


def _by_hand(scenes, paid, due, num):
    """(episode, frame, excess) one after the other."""
    scenes = jax.tree.map(np.asarray, scenes)
    left = {
        (e, t): paid[e, t] - due[e, t]
        for e in range(EPISODES)
        for t in range(FRAMES)
        if due[e, -1] < -OPTIONS["ended"] and paid[e, t] - due[e, t] > OPTIONS["least"]
    }
    found = []
    while left and len(found) < num:
        (e, t), most = max(left.items(), key=lambda item: item[1])
        found.append((e, t, most))
        for f, u in list(left):
            diagonal = np.linalg.norm(scenes.size[e, t], axis=1)
            offset = np.linalg.norm(scenes.center[f, u] - scenes.center[e, t], axis=1)
            like = (offset < OPTIONS["apart"] * diagonal).all()
            like &= (scenes.active[f, u] == scenes.active[e, t]).all()
            if like or (f == e and abs(u - t) < OPTIONS["every"]):
                del left[f, u]
    return found


def test_the_chosen_moments_are_those_of_a_plain_loop(scenes, rewards, chosen):
    by_hand = _by_hand(scenes, *map(np.asarray, rewards), 40)
    assert 5 < len(by_hand) < 40
    assert chosen.known.sum() == len(by_hand)
    assert chosen.known[: len(by_hand)].all()
    for i, (e, t, most) in enumerate(by_hand):
        assert chosen.excess[i] == pytest.approx(most)
        for mine, theirs in zip(chosen.scenes, scenes, strict=True):
            np.testing.assert_array_equal(mine[i], theirs[e, t])
    assert (chosen.excess[len(by_hand) :] == 0).all()


def test_an_episode_that_ends_as_demonstrations_do_gives_nothing(scenes, rewards, chosen):
    well = np.asarray(scenes.center[2])
    assert not any((well == c).all(axis=(1, 2)).any() for c in chosen.scenes.center[chosen.known])
    good = rewards[1].at[:, -1].set(0.0)
    none = hard_negatives.choose(scenes, rewards[0], good, num=40, **OPTIONS)
    assert not np.asarray(none.known).any()
    assert (np.asarray(none.excess) == 0).all()


def test_what_is_paid_as_it_is_due_is_no_cheat(scenes, rewards):
    fair = hard_negatives.choose(scenes, rewards[1], rewards[1], num=40, **OPTIONS)
    assert not np.asarray(fair.known).any()


def test_moments_that_are_not_finite_are_never_chosen(chosen):
    assert np.isfinite(chosen.excess).all()


def test_an_episode_that_was_played_twice_counts_once(scenes, rewards):
    paid, due = (x.at[1].set(x[0]) for x in rewards)
    one = jax.tree.map(lambda x: x.at[2:].set(0), (paid, due))
    found = hard_negatives.choose(scenes, *one, num=40, **OPTIONS)
    center = np.asarray(found.scenes.center)[np.asarray(found.known)].reshape(-1, OBJECTS * 2)
    assert len(center) == len(np.unique(center, axis=0)) > 3


def test_fewer_are_the_first_of_more(scenes, rewards, chosen):
    few = hard_negatives.choose(scenes, *rewards, num=3, **OPTIONS)
    np.testing.assert_array_equal(few.excess, chosen.excess[:3])


def test_due_rewards_are_minus_the_misplacement_of_each_scene(scenes):
    reference = jnp.zeros(OBJECTS, jnp.int32)
    box = jnp.full((OBJECTS, 2), 0.5)
    placed = jnp.arange(OBJECTS) == 2
    places = FinalPlaces(reference, -box, box, placed, ~placed, jnp.array(0.8), ~placed)
    options = {"near_cost_fraction": 0.6, "intrusion_weight": 0.3, "touch": 0.1}
    due = hard_negatives.due_rewards(places, scenes, **options)
    assert due.shape == (EPISODES, FRAMES)
    for e, t in [(0, 0), (2, 17), (3, 29)]:
        one = jax.tree.map(lambda x: x[e, t], scenes)  # noqa: B023
        counted = ~one.is_robot
        cost = misplacement(places, one.center, one.size, one.label, counted, one.active, **options)
        assert float(due[e, t]) == pytest.approx(-float(cost), abs=1e-6)
