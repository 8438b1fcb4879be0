"""Table II: its measures against loops, its rows and tables, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest

from gril_jax.cli import main
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.errors import DemoError
from gril_jax.workflows.build import setup
from gril_jax.workflows.study import frame
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.rows import changed
from gril_jax.workflows.study.table2 import rows as table2_rows
from gril_jax.workflows.study.table2 import table2
from gril_jax.workflows.study.written import csv

CONFIG = RunConfig(env=EnvConfig(name="shoes_in_box"))


def _entry(name, outcome, frames, stages=None):
    return Demo(
        name, lambda: None, Tracks(np.zeros((frames, 1, 2)), None, None, None), 0, outcome, stages
    )


ENTRIES = [
    _entry("000_success", "success", 6, {"lid": 2, "shoe": 4}),
    _entry("001_success", "success", 8, {"lid": 3, "shoe": -1}),
    _entry("050_lid_only", "failure", 4, {"lid": 2, "shoe": -1}),
    _entry("051_one_shoe", "failure", 8),
]
LENGTH = np.array([6, 8, 4, 8], np.int32)
REWARD = -np.random.default_rng(0).random((4, 8)).astype(np.float32)


def test_a_kind_is_read_from_the_name_of_a_failure():
    kinds = [table2.kind_of(entry) for entry in ENTRIES]
    assert kinds == ["success", "success", "lid only", "one shoe"]
    assert table2.kind_of(_entry("x", "failure", 3)) == "failure"


def test_stages_are_counted_from_the_frames_at_which_they_are_finished():
    assert table2.stages_done(ENTRIES[0], 6).tolist() == [0, 0, 1, 1, 2, 2]
    assert table2.stages_done(ENTRIES[3], 3).tolist() == [0, 0, 0]


def test_measures_are_those_of_loops():
    found = table2.measure(REWARD, LENGTH, ENTRIES)
    assert set(table2.MEASURES) <= set(found)
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


def test_the_table_has_the_papers_ratio_beside_ours_and_each_kind_of_failure():
    base = table2.measure(REWARD, LENGTH, ENTRIES)
    lines = [
        {"row": row, "seed": seed, "tau": 0.9} | base | {"rho_held": rho, "order": None}
        for row, rho in (("XIRL", 0.9), ("ours without robot", 0.5))
        for seed in (0, 1)
    ]
    text = table2.text(Found([], lines, [], {}, {}))
    row = next(x for x in text.splitlines() if x.startswith("| ours without robot"))
    assert "| 0.684 | 0.500 (0.500 to 0.500) |" in row
    assert "lid only" in text
    table = csv(lines, table2.columns(lines)).splitlines()
    assert len(table) == 5
    assert table[0].startswith("row,seed,rho_held,")


def test_every_row_sets_the_same_fields_and_builds_a_configuration():
    base = next(iter(table2_rows.ROWS.values()))
    assert all(set(row) == set(base) for row in table2_rows.ROWS.values())
    rows = table2_rows.usable(CONFIG, echo=lambda line: None)
    assert {"GraphIRL with robot", "ours without robot", "ours with soft-DTW"} <= set(rows)
    for row in rows.values():
        if row["encoder.kind"] != "pixels":
            setup.pretrain_config(changed(CONFIG, row), 7)


@pytest.mark.parametrize(("split", "word"), [("failure", "failures"), ("validation", "kept aside")])
def test_too_few_recordings_of_an_outcome_are_one_sentence(split, word):
    names = {"failure": ["a", "b"], "validation": ["c", "d"]} | {split: ["e"]}
    with pytest.raises(DemoError, match=f"demos has 1 .*{word}, but rho needs at least 2"):
        table2._check(Path("demos"), names)


def test_what_the_command_line_says_reaches_the_experiment(monkeypatch, capsys, tmp_path):
    calls = []
    monkeypatch.setattr(frame, "make", lambda _, *args, **kwargs: calls.append((args, kwargs)))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "unused")
    assert main.main(["table2", "--rows", "ours without robot", "--seeds", "3"]) == 0
    assert main.main(["table2", "--quick", "--demos.num", "30"]) == 0
    assert main.main(["table2", "shoes_in_box", "--rows", "ours for policies"]) == 0
    (config, settings), (quick, every), (named, _) = (args for args, _ in calls)
    assert [x.pretrain.steps for x in (config, quick, named)] == [1200, 1200, 6000]
    assert (list(settings.rows), settings.seeds) == (["ours without robot"], 3)
    assert (config.env.name, config.encoder.latent) == ("shoes_in_box", 1)
    assert (quick.demos.num, quick.demos.num_failures, every.seeds) == (30, 21, 2)
    assert list(every.rows) == [name for name in table2_rows.ROWS if name != "XIRL"]
    assert main.main(["table2", "--rows", "none"]) == 2
    assert main.main(["table2", "--reward", "environmental"]) == 2
    assert main.main(["table2", "--resume", str(tmp_path), "--seeds", "2"]) == 2
    assert "--seeds must not be given beside it" in capsys.readouterr().err


def test_shipped_configurations_are_rows_of_the_table():
    from gril_jax.config.files import load

    for name, row in (
        ("shoes_in_box", "ours for policies"),
        ("shoes_in_box_paper", "paper's form without robot"),
    ):
        config = load(name)
        assert changed(config, table2_rows.ROWS[row]) == config
