"""Potential-based shaping: the sum that telescopes, and the policies that it keeps."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.reward import shaping

DISCOUNT = 0.9


def _oracle(potential, terminated, discount):
    """One step after the other, in float64."""
    added = []
    for t in range(len(potential) - 1):
        ended = terminated and t == len(potential) - 2
        added.append(discount * (0.0 if ended else potential[t + 1]) - potential[t])
    return np.array(added)


@pytest.mark.parametrize("terminated", [False, True])
def test_the_terms_of_an_episode_equal_the_loop_and_telescope(terminated):
    potential = np.random.default_rng(0).normal(size=9)
    array, flags = jnp.asarray(potential, jnp.float32), jnp.zeros(8).at[-1].set(terminated)
    step = jax.jit(jax.vmap(lambda a, b, e, d: shaping.step(a, b, e, discount=d)))
    found = step(array[:-1], array[1:], flags, jnp.full(8, DISCOUNT))
    np.testing.assert_allclose(found, _oracle(potential, terminated, DISCOUNT), atol=1e-6)
    last = 0.0 if terminated else DISCOUNT**8 * potential[-1]
    total = (DISCOUNT ** np.arange(8)) @ np.asarray(found)
    assert total == pytest.approx(last - potential[0], abs=1e-6)


def test_what_lies_behind_the_end_does_not_matter_even_if_it_is_nan():
    def total(next_potential):
        ended = jnp.array([True, False])
        return shaping.step(jnp.ones(2), next_potential, ended, discount=DISCOUNT).sum()

    value, slope = jax.value_and_grad(total)(jnp.array([jnp.nan, 2.0]))
    assert value == pytest.approx(-1.0 + 0.9 * 2.0 - 1.0)
    np.testing.assert_allclose(slope, [0.0, DISCOUNT])


# --- a small Markov decision process, solved exactly

STATES, ACTIONS = 7, 3


def _process(seed):
    """Transition probabilities, rewards and potential; the last two states end the task."""
    rng = np.random.default_rng(seed)
    moves = rng.dirichlet(np.full(STATES, 0.3), size=(STATES, ACTIONS))
    return moves, rng.normal(size=(STATES, ACTIONS, STATES)), 3.0 * rng.normal(size=STATES)


def _optimal(moves, rewards, terminal):
    """Action values by value iteration; nothing comes after a terminal state."""
    values = np.zeros(STATES)
    for _ in range(300):
        action_values = (moves * (rewards + DISCOUNT * np.where(terminal, 0, values))).sum(axis=-1)
        values = action_values.max(axis=1)
    return action_values


def _added(potential, terminal, **options):
    """F for every pair of states, on an axis for the actions."""
    shape = (STATES, STATES)
    before = np.broadcast_to(potential[:, None], shape)
    after, ended = (np.broadcast_to(x, shape) for x in (potential, terminal))
    arrays = map(jnp.asarray, (before, after, ended))
    return np.asarray(shaping.step(*arrays, discount=DISCOUNT, **options))[:, None]


@pytest.mark.parametrize("seed", range(3))
def test_the_optimal_policy_stays_and_values_move_by_the_potential(seed):
    moves, rewards, potential = _process(seed)
    terminal = np.arange(STATES) >= STATES - 2
    plain = _optimal(moves, rewards, terminal)
    shaped = _optimal(moves, rewards + _added(potential, terminal), terminal)
    np.testing.assert_array_equal(shaped.argmax(axis=1), plain.argmax(axis=1))
    np.testing.assert_allclose(shaped, plain - potential[:, None], atol=1e-5)


def test_a_potential_that_is_not_zero_at_the_end_can_change_the_optimal_policy():
    terminal = np.arange(STATES) >= STATES - 2
    changed = []
    for seed in range(10):
        moves, rewards, potential = _process(seed)
        added = _added(potential, terminal, zero_at_end=False)
        plain, shaped = (
            _optimal(moves, rewards, terminal),
            _optimal(moves, rewards + added, terminal),
        )
        changed.append((shaped.argmax(axis=1) != plain.argmax(axis=1)).any())
    assert any(changed)


# --- errors


def test_arguments_that_do_not_fit_are_refused():
    step = inspect.unwrap(shaping.step)
    one, two = jnp.ones(1), jnp.ones(2)
    with pytest.raises(ShapeError, match=r"next_potential has shape \(2,\)"):
        step(one, two, discount=0.9)
    with pytest.raises(ShapeError, match=r"terminated has shape \(1,\)"):
        step(two, two, one > 0, discount=0.9)
    for discount in (1.1, -0.1, float("nan")):
        with pytest.raises(ConfigError, match="discount is"):
            step(one, one, discount=discount)
