"""Inputs of a report: arrays and numbers are checked, and numbers become words."""

import math

import numpy as np
import pytest
from support.run_folders import RESULTS, save_profiles, save_rollouts

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.report.data import (
    number,
    read_finished,
    read_outcome,
    read_profiles,
    read_rows,
    read_versions,
)
from gril_jax.report.headline import headline, in_words, verdict
from gril_jax.runs import run_dir
from gril_jax.runs.reading import Phases, write_phases


@pytest.fixture(autouse=True)
def _a_run(tmp_path):
    """The folder is of a run that covers no files."""
    (tmp_path / "config.yaml").touch()
    write_phases(tmp_path, Phases("train", ""))


# --- arrays


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"reward": np.zeros(3, np.float32)}, r"shape \(3,\), but must be \(B, T\)"),
        ({"reward": np.zeros((0, 4), np.float32)}, "must be"),
        ({"reward": np.array([["a"]])}, "must not be of type <U1"),
        ({"length": np.array([1, 2], np.int32)}, r"length has shape \(2,\)"),
        ({"length": np.array([1, 2, 0], np.int32)}, "must lie in 1 to 8"),
        ({"length": np.array([1, 2, 9], np.int32)}, "must lie in 1 to 8"),
        ({"transitions": np.zeros((3, 7), bool)}, r"transitions has shape \(3, 7\)"),
        ({"split": np.array(["train", "test", "train"])}, "'test', but must be train"),
        ({"names": np.array([b"a", b"b", b"c"])}, "names must not be of type"),
        ({"names": np.array([{}, 1, 2], object)}, "not an npz file of plain arrays"),
    ],
)
def test_profiles_that_do_not_fit_together_are_refused(tmp_path, change, message):
    save_profiles(tmp_path, **change)
    with pytest.raises(RunError, match=message):
        read_profiles(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shown": np.array([0, 1, 2])}, r"shown is \[0, 1, 2\], but there are 2 episodes"),
        ({"shown": np.array([-1, 0, 1])}, r"shown is \[-1, 0, 1\]"),
        ({"shown": np.array(0)}, r"shown has shape \(\)"),
        ({"success": np.zeros(3, bool)}, r"success has shape \(3,\)"),
        ({"reward": np.zeros((2, 0), np.float32)}, "must be"),
    ],
)
def test_rollouts_that_do_not_fit_together_are_refused(tmp_path, change, message):
    save_rollouts(tmp_path, **change)
    with pytest.raises(RunError, match=message):
        read_outcome(tmp_path)


def test_success_may_be_saved_as_numbers(tmp_path):
    success = np.array([0.0, 1.0], np.float32)
    save_rollouts(tmp_path, success=success, shown=np.array([0, 1, 0]))
    assert read_outcome(tmp_path) == (2, (False, True, False))


def test_an_array_that_is_missing_is_named(tmp_path):
    np.savez(tmp_path / "rollouts.npz", reward=np.zeros((1, 1), np.float32))
    with pytest.raises(RunError, match="the array 'success' is missing"):
        read_outcome(tmp_path)


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"\x93NUMPY", b"no arrays", None])
def test_bytes_that_are_no_npz_are_refused(tmp_path, data):
    with open(tmp_path / "profiles.npz", "wb") as file:
        np.save(file, np.zeros(3)) if data is None else file.write(data)
    with pytest.raises(RunError, match="not an npz file"):
        read_profiles(tmp_path)


def test_files_that_are_not_there_are_none_or_empty(tmp_path):
    assert read_profiles(tmp_path) is None
    assert read_outcome(tmp_path) is None
    assert read_finished(tmp_path) is None
    assert read_versions(tmp_path) == {}
    assert read_rows(tmp_path) == {"pretrain": [], "ppo": [], "sac": []}


# --- metrics and numbers


def test_rows_are_sorted_by_phase(tmp_path):
    with run_dir.create(tmp_path / "run", RunConfig(), device="cpu", command=["x"]) as run:
        run.log(phase="ppo", env_steps=10, success=float("nan"), seed=3)
        run.log(phase="pretrain", step=1, loss=2)
        run.log(phase="other", word="ignored")
        run.log(step=4)
    rows = read_rows(tmp_path / "run")
    assert rows["ppo"] == [{"env_steps": 10.0, "success": None}]
    assert rows["pretrain"] == [{"step": 1.0, "loss": 2.0}]


@pytest.mark.parametrize(
    ("value", "read"),
    [(3, 3.0), (0.5, 0.5), (None, None), (math.nan, None), (-math.inf, None)],
)
def test_a_number_may_be_missing_but_never_wrong(value, read):
    assert number({"x": value}, "x", "here") == read
    assert number({}, "x", "here") is None


@pytest.mark.parametrize("value", [True, "3", [3], {}, 10**400, -1e200])
def test_what_is_no_usable_number_is_refused(value):
    with pytest.raises(RunError, match="here: x "):
        number({"x": value}, "x", "here")


# --- words for numbers


def test_the_headline_compares_the_trained_policy_with_a_random_one():
    values = {tile.label: (tile.value, tile.note) for tile in headline(RESULTS)}
    assert values["success with deterministic actions"][0] == "90.0%"
    assert values["success with sampled actions"][0] == "80.0%"
    elsewhere = values["success elsewhere, deterministic actions"]
    assert elsewhere[0] == "25.0%"
    assert elsewhere[1].startswith("5 of 20 Layout starts")
    assert values["the task's own start"][0] == "success"
    assert values["success of a random policy"][1].startswith("1 of 20 Jitter starts")
    assert "for the whole run" not in values  # no clock is on the page
    assert headline({}) == []


@pytest.mark.parametrize(
    ("results", "grade", "text"),
    [
        ({}, "open", "has not finished"),
        (
            {"tau": 0.5},
            "open",
            "A reward was learned: alignment tau on held-out demonstrations is 0.5",
        ),
        ({"success": 0.95, "starts": 20}, "good", "It worked: 19 of 20 starts end in success"),
        (
            {"success": 0.5, "success_random": 0.0, "starts": 20},
            "fair",
            "a random policy: 0.0% of 20 starts",
        ),
        ({"success": 0.1, "success_random": 0.05, "starts": 20}, "bad", "It did not work: 2 "),
        (
            {"success": 1.0, "starts": 1, "eval_episodes": 9},
            "good",
            "success from the task's one start.",
        ),
        (
            {"success": 0.0, "starts": 1, "eval_episodes": 9},
            "bad",
            "no success from the task's one start.",
        ),
    ],
)
def test_the_verdict_is_by_success_and_by_what_chance_allows(results, grade, text):
    found = verdict(results)
    assert found.grade == grade
    assert text in found.text


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0, "0.0 s"), (4.26, "4.3 s"), (9.96, "10 s"), (59.4, "59 s"), (59.9, "1 min 0 s"),
     (251, "4 min 11 s"), (3599.7, "1 h 0 min"), (7500, "2 h 5 min")],
)  # fmt: skip
def test_durations_in_words(seconds, words):
    assert in_words(seconds) == words
