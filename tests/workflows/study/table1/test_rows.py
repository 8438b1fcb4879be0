"""The rows of Table I: what they change, what they leave alone, and what is refused."""

import dataclasses
import json

import pytest

from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.files import load
from gril_jax.errors import ConfigError, DemoError
from gril_jax.workflows.study.rows import changed, chosen_rows
from gril_jax.workflows.study.table1.rows import (
    PAPER,
    QUICK,
    ROWS,
    check,
    paths,
    with_steps,
)

BASE = load("match_regions")
ENCODER = ("encoder", "pool", "loss", "pretrain")


def test_every_path_of_a_row_is_a_field_of_the_configuration():
    for path in paths(ROWS):
        section, field = path.split(".")
        assert field in {f.name for f in dataclasses.fields(getattr(BASE, section))}, path


def test_learner_task_and_demonstrations_are_the_same_in_all_rows():
    for change in ROWS.values():
        row = changed(BASE, change)
        assert (row.ppo, row.sac, row.demos) == (BASE.ppo, BASE.sac, BASE.demos)
        assert dataclasses.replace(row.env, reward=None) == BASE.env
        usual = {"reward": "learned", "reward_offset": 1.0}
        assert dataclasses.replace(row.run, **usual) == BASE.run


def test_the_denser_row_is_the_default_and_ours_without_robot_the_paper_s_configuration():
    paper, denser = load("match_regions_paper"), changed(BASE, ROWS["ours audited and denser"])
    assert denser.run == BASE.run
    for section in ENCODER:
        assert getattr(denser, section) == getattr(BASE, section)
    row = changed(BASE, ROWS["ours without robot"])
    assert (row.encoder, row.pool, row.pretrain) == (paper.encoder, paper.pool, paper.pretrain)
    without_copies = {"contrast": row.loss.contrast, "near": row.loss.near}
    assert row.loss == dataclasses.replace(paper.loss, **without_copies)
    assert (paper.ppo, paper.env) == (BASE.ppo, BASE.env)


def test_every_learned_row_sets_what_any_of_them_changes():
    learned = [x for x in ROWS.values() if x["run.reward"] != "environmental"]
    extra = {"encoder.pixels", "encoder.precision"}
    assert len({frozenset(x) - extra for x in learned}) == 1


def test_every_row_is_a_run_of_its_own():
    assert len({json.dumps(change, sort_keys=True) for change in ROWS.values()}) == len(ROWS)
    assert {*PAPER} < {*ROWS}
    assert list(chosen_rows(QUICK, ROWS)) == ["environmental", "ours without robot"]


def test_encoders_can_all_be_trained_for_as_many_steps():
    assert with_steps(ROWS, None) is ROWS
    rows = with_steps(ROWS, 7)
    for name, change in rows.items():
        wanted = 7 if "pretrain.steps" in ROWS[name] else None
        assert change.get("pretrain.steps") == wanted
    assert ROWS["ours audited"]["pretrain.steps"] == 8000  # as it was


def test_another_task_is_refused():
    with pytest.raises(ConfigError, match=r"env\.name is 'shoes_in_box', but must be"):
        check(RunConfig(env=EnvConfig(name="shoes_in_box")))


@pytest.mark.parametrize(
    ("task", "outcomes", "fault"),
    [
        ("shoes_in_box", ["success"] * 20, "holds demonstrations of 'shoes_in_box', but must"),
        ("match_regions", ["success"] * 10, "7 demonstrations to train on beside 3 kept aside"),
        ("match_regions", ["success"] * 9 + ["failure"] * 9, "6 demonstrations to train on"),
        ("match_regions", None, "is damaged"),
    ],
)
def test_demonstrations_of_another_task_or_too_few_are_refused(tmp_path, task, outcomes, fault):
    demos = None if outcomes is None else [{"outcome": outcome} for outcome in outcomes]
    (tmp_path / "demos.json").write_text(json.dumps({"task": task, "demos": demos}))
    config = changed(BASE, {"demos.path": str(tmp_path)})
    with pytest.raises(DemoError, match=fault):
        check(config)


def test_enough_demonstrations_are_taken(tmp_path):
    demos = [{"outcome": "unknown"}] * 11  # 3 are kept aside
    (tmp_path / "demos.json").write_text(json.dumps({"task": "match_regions", "demos": demos}))
    check(changed(BASE, {"demos.path": str(tmp_path)}))
