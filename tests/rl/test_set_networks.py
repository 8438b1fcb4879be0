"""Networks that read objects one by one: neither order nor empty rows matter."""

import jax
import numpy as np
import pytest
from brax.training.agents.ppo import networks

from gril_jax.config.files import load
from gril_jax.rl.policy import fresh_weights
from gril_jax.rl.set_networks import by_object
from gril_jax.workflows.build import policy_setup, setup

ROWS, BEFORE = ((2, 3), (4, 5)), 4
OWN = BEFORE + 2 * 3 + 4 * 5
BLOCKS, BITS = BEFORE + 2 * 3, OWN + 1  # where blocks begin, and the bits of regions and blocks
SIZE = OWN + 1 + 6 + 2  # the bits of the robot and six objects, and two numbers of a memory


def _made(size, **parts):
    plain = networks.make_ppo_networks(size, 3)
    found = by_object(plain, ROWS, size, BEFORE, (32, 32), **parts)
    both = found.policy_network, found.value_network
    weights = fresh_weights(jax.random.key(0), *both)

    @jax.jit
    def say(observation):
        return [net.apply(None, w, observation) for net, w in zip(both, weights, strict=True)]

    return say


@pytest.fixture(scope="module", params=[True, False], ids=["bits", "no bits"])
def made(request):
    """Policy and value of observations, and whether these hold activity bits."""
    size = SIZE if request.param else OWN + 2
    return _made(size, bits=request.param), size, request.param


def _observations(size):
    return np.random.default_rng(0).normal(size=(6, size)).astype(np.float32)


def _close(ours, theirs):
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)


def test_there_are_means_and_spreads_of_actions_and_one_value(made):
    say, size, _ = made
    actions, value = say(_observations(size))
    assert (actions.shape, value.shape) == ((6, 2 * 3), (6,))
    assert np.std(actions) > 0.01


def test_two_blocks_may_change_places_with_their_bits(made):
    say, size, bits = made
    seen = _observations(size)
    other = seen.copy()
    one, two = slice(BLOCKS, BLOCKS + 5), slice(BLOCKS + 15, BLOCKS + 20)
    other[:, one], other[:, two] = seen[:, two], seen[:, one]
    if bits:
        other[:, BITS + 2], other[:, BITS + 5] = seen[:, BITS + 5], seen[:, BITS + 2]
    assert np.abs(other - seen).max() > 0.1
    _close(say(other), say(seen))


def test_a_bit_counts_for_its_own_block(made):
    say, size, bits = made
    if not bits:
        pytest.skip("there are none")
    seen = _observations(size)
    seen[:, BITS:][:, :6] = 0
    other = seen.copy()
    seen[:, BITS + 2], other[:, BITS + 3] = 1, 1
    assert np.abs(np.asarray(say(seen)[0]) - np.asarray(say(other)[0])).max() > 1e-4


@pytest.mark.parametrize("bits", [True, False], ids=["bits", "no bits"])
def test_a_gradient_counts_for_its_own_object_and_the_robots_for_none(bits):
    at = OWN + 7 * bits + 2  # where those of regions and blocks begin, after the robot's
    size = at + 2 * 6 + 2
    say = _made(size, bits=bits, gradient=True)
    seen = _observations(size)
    robot, other, changed = seen.copy(), seen.copy(), seen.copy()
    robot[:, at - 2 : at] += 3.0
    _close(say(robot), say(seen))
    one, two = slice(BLOCKS, BLOCKS + 5), slice(BLOCKS + 15, BLOCKS + 20)
    other[:, one], other[:, two] = seen[:, two], seen[:, one]
    if bits:
        other[:, BITS + 2], other[:, BITS + 5] = seen[:, BITS + 5], seen[:, BITS + 2]
    assert np.abs(np.asarray(say(other)[0]) - np.asarray(say(seen)[0])).max() > 1e-3
    first, last = slice(at + 4, at + 6), slice(at + 10, at + 12)
    other[:, first], other[:, last] = seen[:, last], seen[:, first]
    _close(say(other), say(seen))
    changed[:, -2:] += 1.0  # the memory's numbers still count
    assert np.abs(np.asarray(say(changed)[0]) - np.asarray(say(seen)[0])).max() > 1e-3


@pytest.mark.parametrize("robot", [1, 6])
def test_the_robot_may_have_any_place_among_the_objects(robot):
    """Its bit and its gradient then only stand elsewhere."""
    size = OWN + 7 + 14 + 2
    first, other = (_made(size, bits=True, gradient=True, robot=at) for at in (0, robot))
    seen = _observations(size)
    moved = seen.copy()
    for at, numbers in ((OWN, 1), (OWN + 7, 2)):
        each = moved[:, at : at + 7 * numbers].reshape(6, 7, numbers)
        own, rest = each[:, :1].copy(), each[:, 1:].copy()
        each[:] = np.concatenate([rest[:, :robot], own, rest[:, robot:]], axis=1)
    assert np.abs(moved - seen).max() > 0.1
    _close(other(moved), first(seen))


def test_a_row_of_zeros_is_not_there(made):
    """Whatever its bit says; and with no row at all everything is finite."""
    say, size, bits = made
    seen = _observations(size)
    seen[:, BLOCKS + 15 : BLOCKS + 20] = 0
    if bits:
        other = seen.copy()
        other[:, BITS + 5] += 3.0
        _close(say(other), say(seen))
    seen[:, BEFORE:OWN] = 0
    assert all(np.isfinite(x).all() for x in say(seen))


@pytest.mark.parametrize("hidden", [(3,), (20, 5)])
def test_any_width_will_do(hidden):
    plain = networks.make_ppo_networks(SIZE, 3)
    net = by_object(plain, ROWS, SIZE, BEFORE, hidden, bits=True).policy_network
    weights = net.init(jax.random.key(0))
    said = jax.jit(lambda x: net.apply(None, weights, x))(_observations(SIZE))
    assert said.shape == (6, 2 * 3)
    assert np.isfinite(said).all()


def test_half_products_come_near_whole_ones():
    """Outputs are float32 and weights are the same; only products differ, by some 2^-8."""
    plain = networks.make_ppo_networks(SIZE, 3)
    whole, half = (
        by_object(plain, ROWS, SIZE, BEFORE, (32, 32), bits=True, half=half).value_network
        for half in (False, True)
    )
    weights = whole.init(jax.random.key(0))
    assert jax.tree.map(np.shape, half.init(jax.random.key(1))) == jax.tree.map(np.shape, weights)
    seen = _observations(SIZE)
    said = [np.asarray(jax.jit(net.apply)(None, weights, seen)) for net in (whole, half)]
    assert said[1].dtype == np.float32
    np.testing.assert_allclose(said[1], said[0], atol=0.03)
    assert np.abs(said[1] - said[0]).max() > 0


@pytest.mark.parametrize(
    ("precision", "half"), [("auto", False), ("float32", False), ("bfloat16", True)]
)
def test_products_are_whole_on_a_cpu_unless_they_are_asked_for(precision, half):
    config = load("magical_suite", ["--task", "move_to_region", "--ppo.precision", precision])
    env = setup.make_env(config.env, training=True)
    assert policy_setup.make_algorithm(config, env).static.half == half
