"""Meaning of the actions of MatchRegions."""

import math

import chex
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical import simulator

from gril_jax import envs

OPEN = math.pi / 8


def test_smooth_turning_is_linear_over_the_whole_range():
    env = envs.make("match_regions")
    smooth = envs.make("match_regions", turn="smooth")
    for turn in (0.02, 0.3, 1.0):
        gentle = smooth._command(jnp.array([0.0, turn, 0.0]))
        original = env._command(jnp.array([0.0, turn / 16, 0.0]))
        chex.assert_trees_all_close(gentle, original, rtol=1e-6)


@pytest.mark.parametrize(
    ("action", "speed", "turn", "opening"),
    [
        ([1.0, 0.0, 0.0], 0.8, 0, OPEN),
        ([0.3, 0.0, 0.0], 0.0, 0, OPEN),
        ([-0.6, 0.0, -1.0], -0.6, 0, OPEN),
        ([0.0, 0.6, 0.1], 0.0, 1.5, 0.0),
        ([0.0, -0.9, 1.0], 0.0, -1.5, 0.0),
        ([0.0, 0.4, 0.0], 0.0, 0, OPEN),
    ],
)
def test_magical_rounds_actions_to_its_eighteen(action, speed, turn, opening):
    magical = envs.make("match_regions", physics="magical")
    command = magical._command(jnp.array(action))
    np.testing.assert_allclose(list(map(float, command)), [speed, turn, opening], rtol=1e-6)


def test_magicals_numbers_are_its_eighteen_commands():
    """9 * grip + 3 * turn + drive, decoded by a plain loop."""
    found = simulator.from_magical(np.arange(18))
    for number, action in enumerate(found):
        grip, turn, drive = number // 9, number // 3 % 3, number % 3
        command = simulator.rounded_command(jnp.asarray(action))
        expected = [(0.0, 0.8, -0.6)[drive], (0.0, 1.5, -1.5)[turn], (OPEN, 0.0)[grip]]
        np.testing.assert_allclose(list(map(float, command)), expected, rtol=1e-6)
    assert simulator.from_magical(np.zeros((2, 0), int)).shape == (2, 0, 3)


@pytest.mark.parametrize("wrong", [-1, 18])
def test_other_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must lie in 0 to 17"):
        simulator.from_magical(np.array([0, wrong]))
