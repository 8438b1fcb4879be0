"""What actions of MatchRegions mean, and what a step does with them."""

import math

import chex
import jax.numpy as jnp
import match_regions_lanes as lanes
import numpy as np
import pytest
from gril_jax.envs import match_regions_action as actions
from match_regions_lanes import LANES

from gril_jax import envs

OPEN = math.pi / 8


@pytest.fixture(scope="module")
def env():
    return lanes.task()


@pytest.fixture(scope="module")
def demo():
    return lanes.demo()


@pytest.fixture(scope="module")
def step():
    return lanes.step()


def test_smooth_turning_is_linear_over_the_whole_range(env):
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


def test_actions_beyond_the_box_act_like_its_border(demo, step):
    action = np.tile([7.0, -7.0, 7.0], (LANES, 1))
    a = step(demo, jnp.asarray(action, jnp.float32))
    b = step(demo, jnp.asarray(np.sign(action), jnp.float32))
    chex.assert_trees_all_equal(a, b)


def test_nearest_is_the_least_distance_since_reset(demo, step):
    """The robot of the Demo start drives away from the square and, later, back."""
    state, least = demo, np.asarray(demo.data.nearest)
    for t in range(10):
        action = jnp.tile(jnp.array([1.0 if t < 5 else -1.0, 0.0, 0.0]), (LANES, 1))
        state = step(state, action)
        pose = np.asarray(state.data.pose)
        least = np.minimum(least, np.linalg.norm(pose[:, 3:5, :2] - pose[:, :1, :2], axis=2))
        np.testing.assert_allclose(state.data.nearest, least, rtol=1e-5)


def test_the_task_itself_never_ends(demo, step):
    state = step(demo, jnp.ones((LANES, 3)))
    assert not demo.done.any()
    assert not state.done.any()


def test_magicals_numbers_are_its_eighteen_commands():
    """9 * grip + 3 * turn + drive, decoded by a plain loop."""
    found = actions.from_magical(np.arange(18))
    for number, action in enumerate(found):
        grip, turn, drive = number // 9, number // 3 % 3, number % 3
        command = actions.rounded_command(jnp.asarray(action))
        expected = [(0.0, 0.8, -0.6)[drive], (0.0, 1.5, -1.5)[turn], (OPEN, 0.0)[grip]]
        np.testing.assert_allclose(list(map(float, command)), expected, rtol=1e-6)
    assert actions.from_magical(np.zeros((2, 0), int)).shape == (2, 0, 3)


@pytest.mark.parametrize("wrong", [-1, 18])
def test_other_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must lie in 0 to 17"):
        actions.from_magical(np.array([0, wrong]))
