"""Meaning of the actions of MatchRegions."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical import simulator

from gril_jax import envs

OPEN = math.pi / 8


def test_a_turn_is_bang_bang_beyond_a_sixteenth():
    """An offset of a turns at a / (2 dt), at most at 2.5 rad/s."""
    env = envs.make("match_regions")
    for turn in (-1.0, 0.02, 0.0625, 0.3):
        rate = env._command(jnp.array([0.0, turn, 0.0])).turn / (2 * env._engine.dt)
        assert float(rate) == pytest.approx(40 * turn, rel=1e-6)
        assert (abs(rate) >= 2.5 - 1e-6) == (abs(turn) >= 0.0625)


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
