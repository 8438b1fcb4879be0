"""Dead ends: what is counted as one, and pushes to where a reward rises."""

import functools

import jax
import numpy as np
import pytest
from gril_jax.envs.tabletop.hand import Hand
from gril_jax.experiments.tabletop import dead_ends
from gril_jax.experiments.tabletop.dead_ends import Push, summary

from gril_jax import envs


@functools.cache
def _rubbish():
    return envs.make("rubbish_in_bin")


@functools.cache
def _start():
    reset = jax.jit(jax.vmap(_rubbish().reset))
    starts = jax.device_get(reset(jax.random.split(jax.random.key(0), 1)))
    return jax.tree.map(lambda x: x[0], starts)


def test_a_dead_end_is_what_the_expert_could_finish_before_and_cannot_after():
    found = [
        Push(-1.0, -0.6, could=True, can=False, upwards=True),
        Push(-1.0, -0.98, could=True, can=False, upwards=False),
        Push(-1.0, -0.2, could=True, can=True, upwards=True),
        Push(-1.0, -0.1, could=False, can=False, upwards=True),  # it could not before, either
    ]
    assert summary(found, 2.0) == {
        "pushes": 4,
        "from_moments_that_the_expert_finishes": 3,
        "dead_ends": 2,
        "dead_ends_upwards": 1,
        "paid_dead_ends": 1,
        "most_that_a_dead_end_gains": pytest.approx(0.2),
        "mean_gain_of_dead_ends": pytest.approx(0.105),
        "mean_gain_of_the_others": pytest.approx(0.4),
    }


def test_without_a_dead_end_nothing_is_gained():
    found = summary([Push(-1.0, -0.5, could=True, can=True, upwards=False)], 1.0)
    assert (found["dead_ends"], found["most_that_a_dead_end_gains"]) == (0, 0.0)


@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 1.0)])
def test_a_push_goes_to_where_the_reward_rises(way, monkeypatch):
    """The robot's left is the picture's right, and what is further from the camera is above."""
    env = _rubbish()
    struck = []
    monkeypatch.setattr(
        dead_ends.moves, "knock", lambda hand, place, pace, way, **_: struck.append(way)
    )
    pay = lambda center, size: float(np.sum(center[4:] @ np.array(way)))  # noqa: E731
    dead_ends._push(env, Hand(env, _start()), np.random.default_rng(0), pay)
    toward = {(1.0, 0.0): np.array([0.0, 1.0]), (0.0, 1.0): np.array([-1.0, 0.0])}[way]
    assert np.dot(struck[0], toward) > np.cos(np.pi / 8 + 0.15)
