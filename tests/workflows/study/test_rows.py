"""Rows by their names, and settings that are read as they were written."""

from dataclasses import replace

import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, RunError
from gril_jax.workflows.study.rows import (
    Settings,
    changed,
    chosen_rows,
    differing,
    read_settings,
    with_seeds,
    write_settings,
)
from gril_jax.workflows.study.soundness import rows as soundness_rows
from gril_jax.workflows.study.table1 import rows as table1_rows
from gril_jax.workflows.study.table2 import rows as table2_rows

ROWS = {"plain": {"pool.alpha": 1.0}, "fancy": {"pool.alpha": 2.0}}


def test_rows_come_in_the_order_of_their_names_on_the_command_line():
    assert chosen_rows(None, ROWS) is ROWS
    assert list(chosen_rows(" fancy,plain", ROWS).items()) == [*ROWS.items()][::-1]


def test_an_unknown_row_and_one_named_twice_are_refused():
    with pytest.raises(ConfigError, match=r"names 'fanci' \(did you mean fancy\?\), but the rows"):
        chosen_rows("fanci", ROWS)
    with pytest.raises(ConfigError, match="names 'plain' twice"):
        chosen_rows("plain,plain", ROWS)


@pytest.mark.parametrize("known", [table1_rows, table2_rows, soundness_rows])
def test_a_row_can_be_named_on_the_command_line(known):
    assert not any("," in name for name in known.ROWS)


def test_a_value_out_of_range_is_refused():
    with pytest.raises(ConfigError, match=r"pool\.alpha is 0"):
        changed(RunConfig(), {"pool.alpha": 0.0})


def test_each_row_has_all_seeds_from_the_configuration_s_on():
    configs = [changed(RunConfig(), {"run.seed": 7, **change}) for change in ROWS.values()]
    rows = with_seeds(configs, 2)
    assert [(row.cell, row.seed, row.config.run.seed) for row in rows] == [
        (0, 0, 7),
        (0, 1, 8),
        (1, 0, 7),
        (1, 1, 8),
    ]
    assert [row.config.pool.alpha for row in rows] == [1.0, 1.0, 2.0, 2.0]


def test_runs_may_differ_in_what_every_row_sets_and_in_their_folders():
    first = RunConfig()
    other = replace(
        first, pool=replace(first.pool, alpha=3.0, tau=0.01), run=replace(first.run, out="else")
    )
    tau = f"pool.tau (0.01, not {first.pool.tau})"
    assert differing(first, other, ROWS) == [tau]
    alpha = f"pool.alpha (3.0, not {first.pool.alpha})"
    assert differing(first, other, ROWS | {"as it is": {}}) == [alpha, tau]
    assert differing(first, first, {}) == []


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("table1", table1_rows.Settings({"a": {"ppo.hidden": (10, 1)}}, seeds=3)),
        ("table2", Settings({"XIRL": table2_rows.ROWS["XIRL"]}, 3)),
        ("soundness", soundness_rows.Settings({"a": {"pool.alpha": 2.0}}, 3, policies=False)),
    ],
)
def test_settings_are_read_as_they_were_written(tmp_path, name, settings):
    write_settings(tmp_path, name, settings)
    assert read_settings(tmp_path, name, type(settings)) == settings


@pytest.mark.parametrize("text", [None, "{", "[]", '{"stray": 1}', '{"rows": []}'])
def test_a_folder_without_whole_settings_is_refused(tmp_path, text):
    if text is not None:
        (tmp_path / "made.json").write_text(text)
    with pytest.raises(RunError, match=r"is no run of gril made: its made\.json is missing or"):
        read_settings(tmp_path, "made", Settings)
