"""Rows by their names, and settings that are read as they were written."""

from dataclasses import dataclass, replace

import pytest
from gril_jax.experiments.sweeps.named_rows import (
    chosen_rows,
    differing,
    read_settings,
    write_settings,
)

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, RunError

ROWS = {"plain": {"pool.alpha": 1.0}, "fancy": {"pool.alpha": 2.0}}


@dataclass(frozen=True)
class Made:
    """Settings of some experiment."""

    seeds: int = 5


def test_rows_come_in_the_order_of_their_names_on_the_command_line():
    assert chosen_rows(None, ROWS) is ROWS
    assert list(chosen_rows(" fancy,plain", ROWS).items()) == [*ROWS.items()][::-1]


def test_an_unknown_row_and_one_named_twice_are_refused():
    with pytest.raises(ConfigError, match=r"names 'fanci' \(did you mean fancy\?\), but the rows"):
        chosen_rows("fanci", ROWS)
    with pytest.raises(ConfigError, match="names 'plain' twice"):
        chosen_rows("plain,plain", ROWS)


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


def test_settings_are_read_as_they_were_written_or_refused(tmp_path):
    write_settings(tmp_path / "made.json", Made(3))
    assert read_settings(tmp_path / "made.json", Made, "experiment") == Made(3)
    (tmp_path / "made.json").write_text('{"stray": 1}')
    with pytest.raises(RunError, match=r"is no experiment: its made\.json is missing or damaged"):
        read_settings(tmp_path / "made.json", Made, "experiment")
