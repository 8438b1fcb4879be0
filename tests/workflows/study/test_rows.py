"""Rows by their names, and fields that are changed and told apart."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.workflows.study.rows import (
    changed,
    chosen,
    difference,
    scale,
    without_twins,
)

ROWS = ("plain", "fancy", "fancy at level A")
CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "pool.alpha": st.integers(1, 9) | st.floats(0.5, 9.0),
        "loss.lambda": st.integers(0, 3),
        "ppo.hidden": st.lists(st.integers(1, 64), min_size=1, max_size=3),
        "pool.noise": st.none() | st.floats(0.0, 0.1),
        "encoder.relations": st.booleans(),
        "run.reward": st.sampled_from(["learned", "environmental"]),
    },
)


@given(CHANGES)
def test_a_difference_makes_the_one_of_the_other(change):
    base = RunConfig()
    config = changed(base, change)
    found = difference(base, config)
    assert changed(base, found) == config
    assert {path.rstrip("_") for path in found} <= {*change}
    for section in dataclasses.fields(base):
        for field, value in vars(getattr(config, section.name)).items():
            usual = getattr(getattr(base, section.name), field)
            if usual is not None and value is not None:
                assert type(value) is type(usual), field


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"pool.alpha": 0.0}, r"pool\.alpha is 0"),
        ({"pool.alphas": 1}, r"no field 'pool\.alphas' \(did you mean pool\.alpha\?\)"),
        ({"poll.alpha": 1}, r"no field 'poll\.alpha' \(did you mean"),
        ({"pool.alpha": "high"}, "must be of the kind float"),
        ({"pretrain.steps": 1.5}, "must be of the kind int"),
        ({"pretrain.steps": True}, "must be of the kind int"),
        ({"encoder.kind": "papre"}, "must be one of 'paper'"),
        ({"encoder.relations": 1}, "must be of the kind bool"),
    ],
)
def test_what_no_field_takes_is_refused(change, fault):
    with pytest.raises(ConfigError, match=fault):
        changed(RunConfig(), change)


def test_a_factor_is_of_the_configuration_s_own_number():
    base = RunConfig()
    found = changed(base, {"ppo.num_timesteps": "x0.5", "pool.alpha": "x2"})
    assert found.ppo.num_timesteps == base.ppo.num_timesteps // 2
    assert found.pool.alpha == 2 * base.pool.alpha
    assert [scale(x) for x in ("x0.5", "xirl", 3, None)] == [0.5, None, None, None]


def test_rows_come_in_the_order_of_their_names_and_patterns_each_once():
    assert chosen(["fancy", "plain"], ROWS) == ["fancy", "plain"]
    assert chosen(["fancy*", "*"], ROWS) == ["fancy", "fancy at level A", "plain"]
    with pytest.raises(ConfigError, match=r"names 'fanci' \(did you mean fancy\?\), but the rows"):
        chosen(["fanci"], ROWS)


def test_rows_with_the_same_results_are_made_once():
    own, films = {"run.reward": "environmental"}, {"ppo.video_state_resets": 0.5}
    rows = {
        "learned": {}, "learned again": {}, "lambda": {"loss.lambda": 2},
        "own": own, "own with lambda": own | {"loss.lambda": 2},
        "own of a set": own | {"demos.num": 9},
        "from films": own | films, "from other films": own | films | {"demos.num": 9},
    }  # fmt: skip
    kept, twins = without_twins({name: changed(RunConfig(), row) for name, row in rows.items()})
    assert twins == {"learned again": "learned", "own with lambda": "own", "own of a set": "own"}
    assert [*kept] == [name for name in rows if name not in twins]
