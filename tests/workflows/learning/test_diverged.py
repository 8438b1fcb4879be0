"""Trainings that leave the finite numbers: which ones, where, and what is said."""

import numpy as np
import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.workflows.learning import diverged

NAMES = ("consistency", "loss")


def _metrics(**at):
    """Two metrics of three seeds and four updates, with numbers that are not finite in places."""
    found = {name: np.ones((3, 4), np.float32) for name in NAMES}
    for name, places in at.items():
        for seed, update, value in places:
            found[name][seed, update] = value
    return found


def test_the_first_update_that_is_not_finite_is_noted_for_good():
    bad = diverged.noted(diverged.unknown(3), _metrics(), NAMES, 0)
    assert diverged.faults(bad, NAMES) == {}
    at = _metrics(loss=[(1, 2, np.nan), (1, 3, np.inf)], consistency=[(1, 3, np.nan)])
    bad = diverged.noted(bad, at, NAMES, 100)
    assert diverged.faults(bad, NAMES) == {1: diverged.Fault(103, "loss")}
    both = _metrics(consistency=[(1, 0, np.nan), (2, 0, -np.inf)], loss=[(2, 0, np.nan)])
    bad = diverged.noted(bad, both, NAMES, 200)
    wanted = {1: diverged.Fault(103, "loss"), 2: diverged.Fault(201, "consistency")}
    assert diverged.faults(bad, NAMES) == wanted


def test_an_earlier_update_comes_first_whatever_its_metric():
    at = _metrics(consistency=[(0, 3, np.nan)], loss=[(0, 1, -2e30)])
    bad = diverged.noted(diverged.unknown(3), at, NAMES, 0)
    assert diverged.faults(bad, NAMES) == {0: diverged.Fault(2, "loss")}


def test_finite_trees_are_told_by_seed():
    tree = {"a": np.ones((3, 2)), "b": np.array([0.0, np.nan, 1.0])}
    assert diverged.are_finite(tree).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("said", "words"),
    [
        (
            diverged.of_reward(RunConfig(), diverged.Fault(7, "gradient_norm")),
            (
                "gradient norm is not finite, or above 1e+30, at gradient step 7",
                "--loss.perturbation-weight",
            ),
        ),
        (diverged.of_reward(RunConfig(), None), ("the learned reward is not finite",)),
        (
            diverged.of_policy(RunConfig(), diverged.Fault(3, "loss/value"), 100),
            (
                "loss/value is not finite, or above 1e+30, at env step 300",
                "--ppo.learning-rate (0.0003)",
            ),
        ),
        (
            diverged.of_policy(RunConfig(), diverged.Fault(3, diverged.UNDONE), 100),
            ("ended at env step 300", "check-task"),
        ),
    ],
)
def test_a_sentence_says_what_where_and_what_to_lower(said, words):
    assert all(word in said for word in words), said


def test_a_phase_goes_on_while_a_seed_is_left():
    diverged.require_some({}, 1)
    diverged.require_some({0: "a", 2: "b"}, 3)
    with pytest.raises(RunError, match="a"):
        diverged.require_some({0: "a"}, 1)
    with pytest.raises(RunError, match="other 1 failed, too"):
        diverged.require_some({1: "b", 0: "a"}, 2)
    with pytest.raises(RunError, match="seed 12 failed: b"):
        diverged.require_all({2: "b"}, 10)
