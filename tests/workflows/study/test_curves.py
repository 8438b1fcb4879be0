"""The curves of training, and what they come to, beside plain NumPy."""

import dataclasses

import numpy as np
import pytest

from gril_jax.workflows.study.counted import Counted
from gril_jax.workflows.study.curves import curves, first_at, in_last_tenth, numbers

SCORES = ("success", "success_sampled", "success_ever", "score")
ROWS, TAUS = [(1, 0), (0, 0), (0, 1)], [0.9, None, 0.8]


@pytest.fixture(scope="module")
def lines():
    """Lines of metrics.jsonl of two programs."""
    draw = np.random.default_rng(0)
    return [
        {"phase": phase, "env_steps": 100 * (k + 1)}
        | {name: draw.uniform(size=3).tolist() for name in SCORES}
        for k in range(20)
        for phase in ("policy-0", "policy-1")
    ]


def _found(lines, scores=None):
    lines = [line | (scores or {}) for line in lines]
    return curves({"policy-0": {"rows": ROWS, "taus": TAUS}, "demos": {}}, lines)


def test_a_policy_s_curve_is_its_column_of_its_program_s_metrics(lines):
    found, own = _found(lines), [line for line in lines if line["phase"] == "policy-0"]
    assert [(curve.cell, curve.seed, curve.tau) for curve in found] == [
        (0, 0, None),
        (0, 1, 0.8),
        (1, 0, 0.9),
    ]
    for i, curve in zip((1, 2, 0), found, strict=True):
        np.testing.assert_array_equal(curve.env_steps, [line["env_steps"] for line in own])
        assert {*curve.scores} == {*SCORES}
        for name in SCORES:
            np.testing.assert_array_equal(curve.scores[name], [line[name][i] for line in own])


def test_a_number_that_was_not_finite_is_told_as_such(lines):
    """metrics.jsonl holds null in its place."""
    found = _found(lines, {"score": [None, 0.5, 0.5]})
    assert np.isnan(numbers(found[2])["score"])


def test_a_policy_s_numbers_are_means_over_the_last_tenth_and_the_first_with_80_percent(lines):
    last = [line for line in lines if line["phase"] == "policy-0"][-2:]
    for i, curve in zip((1, 2, 0), _found(lines), strict=True):
        found = numbers(curve)
        assert found["env_steps"] == 2000
        for name in SCORES:
            assert found[name] == pytest.approx(np.mean([line[name][i] for line in last]))
        reached = curve.env_steps[curve.scores["success_sampled"] >= 0.8]
        assert found["steps_80"] == reached[0]


def test_the_first_variant_with_several_starts_tells_most(lines):
    curve, *_ = _found(lines)
    own, many = Counted(4, 1), Counted(4, 4)
    for starts, suffix in (
        ({"demo": own, "jitter": many, "layout": many}, "_jitter"),
        ({"jitter": many, "layout": many}, ""),
        ({"demo": own}, ""),
    ):
        assert dataclasses.replace(curve, starts=starts).headline == suffix


def test_a_level_is_reached_at_the_first_evaluation_at_or_above_it():
    success, at = np.array([0.1, 0.8, 0.2, 0.9]), np.array([10.0, 20.0, 30.0, 40.0])
    assert first_at(success, at, level=0.8) == 20.0  # reached exactly, and lost again later
    assert first_at(success, at, level=0.85) == 40.0
    assert first_at(success, at, level=0.05) == 10.0  # at once
    assert np.isnan(first_at(success, at, level=0.95))  # never
    assert first_at(np.array([np.float32(0.8)]).astype(float), at[:1], level=0.8) == 10.0


@pytest.mark.parametrize(("evaluations", "last"), [(1, 1), (4, 1), (10, 1), (11, 2), (20, 2)])
def test_the_last_tenth_has_the_evaluations_after_nine_tenths(evaluations, last):
    chosen = in_last_tenth(np.arange(1, evaluations + 1) * 30.0)
    np.testing.assert_array_equal(chosen, np.arange(evaluations) >= evaluations - last)
