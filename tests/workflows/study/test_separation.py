"""How rewards tell success from failure, against loops, and what is refused."""

import types

import numpy as np
import pytest

from gril_jax.config import RunConfig
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.errors import DemoError
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study import separation


def _entry(name, outcome, frames, stages=None):
    place = np.zeros((frames, 1, 2), np.float32)
    tracks = Tracks(place, place + 1, np.zeros(1, np.int32), np.ones((frames, 1), bool))
    return Demo(name, np.zeros((frames, 2, 2, 3), np.uint8), tracks, 0, outcome, stages)


ENTRIES = [
    _entry("000_success", "success", 6, {"lid": 2, "shoe": 4}),
    _entry("001_success", "success", 8, {"lid": 3, "shoe": -1}),
    _entry("050_lid_only", "failure", 4, {"lid": 2, "shoe": -1}),
    _entry("051_one_shoe", "failure", 8),
]
LENGTH = np.array([6, 8, 4, 8], np.int32)
REWARD = -np.random.default_rng(0).random((4, 8)).astype(np.float32)


def test_a_kind_is_read_from_the_name_of_a_failure():
    kinds = [separation.kind_of(entry) for entry in ENTRIES]
    assert kinds == ["success", "success", "lid only", "one shoe"]
    assert separation.kind_of(_entry("x", "failure", 3)) == "failure"


def test_stages_are_counted_from_the_frames_at_which_they_are_finished():
    assert separation.stages_done(ENTRIES[0], 6).tolist() == [0, 0, 1, 1, 2, 2]
    assert separation.stages_done(ENTRIES[3], 3).tolist() == [0, 0, 0]


def test_measures_are_those_of_loops():
    found = separation.figures(REWARD, LENGTH, ENTRIES)
    assert set(separation.NUMBERS) <= set(found)
    own = [r[:n] for r, n in zip(REWARD, LENGTH, strict=True)]
    for name, cost in {
        "natural": [-r.sum() for r in own],
        "resampled": [-r.mean() for r in own],
        "held": [-r.sum() - (8 - len(r)) * r[-1] for r in own],
    }.items():
        expected = np.mean(cost[:2]) / np.mean(cost[2:])
        np.testing.assert_allclose(found[f"rho_{name}"], expected, rtol=1e-5)
    last = [r[-1] for r in own]
    expected = np.mean([a > b for a in last[:2] for b in last[2:]])
    np.testing.assert_allclose(found["auc_final"], expected)
    np.testing.assert_allclose(found["auc lid only"], np.mean([a > last[2] for a in last[:2]]))
    np.testing.assert_allclose(found["last success"], np.mean(last[:2]), rtol=1e-6)
    assert -1 <= found["order"] <= 1


@pytest.mark.parametrize(("split", "word"), [("failure", "failures"), ("validation", "kept aside")])
def test_too_few_recordings_of_an_outcome_are_one_sentence(split, word):
    names = {"failure": ["a", "b"], "validation": ["c", "d"]} | {split: ["e"]}
    with pytest.raises(DemoError, match=f"demos has 1 .*{word}, but rho needs at least 2"):
        separation.require_both("demos", names)


def test_without_failures_it_is_left_out_beside_other_measures_and_refused_alone():
    names = {"failure": [], "validation": ["000_success", "001_success"]}
    demos = Demonstrations(types.SimpleNamespace(where="demos"), names, 0)
    beside = separation.Separation(lambda config: demos, alone=False)
    assert not beside.asked(RunConfig())
    with pytest.raises(DemoError, match="has 0 failures"):
        separation.Separation(lambda config: demos).asked(RunConfig())
    names["failure"].append("050_lid_only")
    with pytest.raises(DemoError, match="has 1 failures"):
        beside.asked(RunConfig())
