"""The tables of a sweep beside plain loops over the lines that a run writes."""

import csv as csv_format

import numpy as np
import pytest
from gril_jax.report.sweep_table import Result, csv, first_at, markdown, median_reached, results

COLUMNS = ("success", "success_sampled", "success_ever", "score")
ROWS = [(0, 3), (1, 3), (0, 4), (1, 4)]
TAUS = [0.9, None, 0.8, None]


@pytest.fixture(scope="module")
def curve():
    """Three chunks of four policies, as metrics.jsonl has them."""
    draw = np.random.default_rng(0)
    return [
        {"env_steps": 100 * (i + 1)} | {name: draw.uniform(size=4).tolist() for name in COLUMNS}
        for i in range(3)
    ]


@pytest.fixture(scope="module")
def found(curve):
    return results(ROWS, TAUS, curve)


def test_each_policy_gets_its_own_numbers_of_each_line(curve, found):
    for i, result in enumerate(found):
        assert (result.cell, result.seed, result.tau) == (*ROWS[i], TAUS[i])
        np.testing.assert_array_equal(result.env_steps, [100, 200, 300])
        for name in COLUMNS:
            assert result.scores[name].tolist() == [line[name][i] for line in curve]


def test_a_number_that_was_not_finite_is_told_as_such(curve):
    """metrics.jsonl holds null in its place."""
    broken = [curve[0] | {"score": [None, 0.5, 0.5, 0.5]}]
    (first, *_) = results(ROWS, TAUS, broken)
    assert np.isnan(first.scores["score"][0])
    assert "nan" in markdown(["a", "b"], [first])


def test_a_level_is_reached_at_the_first_evaluation_at_or_above_it():
    success, at = np.array([0.1, 0.8, 0.2, 0.9]), np.array([10.0, 20.0, 30.0, 40.0])
    assert first_at(success, at, level=0.8) == 20.0  # reached exactly, and lost again later
    assert first_at(success, at, level=0.85) == 40.0
    assert first_at(success, at, level=0.05) == 10.0  # at once
    assert np.isnan(first_at(success, at, level=0.95))  # never
    assert first_at(np.array([np.float32(0.8)]).astype(float), at[:1], level=0.8) == 10.0


def test_a_median_counts_those_that_never_got_there_as_the_slowest():
    for at, said in (
        ([4.0, np.nan, 2.0], "4.00 (2 of 3)"),
        ([np.nan, 2.0, np.nan], "never (1 of 3)"),
        ([1.0, 3.0], "3.00 (2 of 2)"),
        ([1.0, np.nan], "never (1 of 2)"),
    ):
        assert median_reached(np.array(at), ".2f") == said


def test_the_csv_has_the_last_scores_by_cell_and_seed(curve, found):
    lines = list(csv_format.DictReader(csv(["a", "b, c"], found).splitlines()))
    order = sorted(range(4), key=lambda i: ROWS[i])
    assert [(x["cell"], int(x["seed"])) for x in lines] == [
        (("a", "b, c")[ROWS[i][0]], ROWS[i][1]) for i in order
    ]
    for line, i in zip(lines, order, strict=True):
        assert line["env_steps"] == "300"
        assert line["tau"] == ("" if TAUS[i] is None else f"{TAUS[i]}")
        for name in COLUMNS:
            assert float(line[name]) == pytest.approx(curve[-1][name][i], rel=1e-5)
        reached = [x["env_steps"] for x in curve if x["success_sampled"][i] >= 0.8]
        assert line["steps_80"] == (str(reached[0]) if reached else "")


def test_the_table_has_mean_and_interquartile_mean_of_each_cell():
    """Of four seeds the lowest and the highest are left out; the interval is around the rest."""
    last = [0.0, 0.25, 0.5, 0.85]
    found = [
        Result(0, k, 0.5 + 0.1 * k, np.array([10.0]), {name: np.array([x]) for name in COLUMNS})
        for k, x in enumerate(last)
    ]
    table = markdown(["as configured"], found)
    line = table.splitlines()[2]
    assert line.startswith("| as configured | 4 | 0.400; 0.375 (")
    assert line.endswith("| never (1 of 4) | 0.650 |")
    low, high = (float(x) for x in line.split("(")[1].split(")")[0].split(" to "))
    assert 0.0 <= low < 0.375 < high <= 0.85


def test_a_cell_without_policies_yet_has_no_line(found):
    table = markdown(["a", "b", "not yet"], found)
    assert [line.split(" | ")[0] for line in table.splitlines()[2:4]] == ["| a", "| b"]
    assert "not yet" not in table
    assert len(table.splitlines()) == 6


def test_of_nothing_there_are_only_headings():
    assert len(markdown(["a"], []).splitlines()) == 4
    assert csv(["a"], []).splitlines() == [
        "cell,seed,env_steps,success,success_sampled,success_ever,score,steps_80,tau"
    ]
