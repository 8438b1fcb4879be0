"""metrics.jsonl: what is cut is what came after a phase's rows, and nothing else."""

import pytest

from gril_jax.errors import RunError
from gril_jax.runs.metric_rows import MetricRows, read_rows


@pytest.fixture
def rows(tmp_path):
    opened = MetricRows(tmp_path / "metrics.jsonl")
    for phase, count in (("first", 2), ("second", 3)):
        for i in range(count):
            opened.append({"phase": phase, "i": i})
    yield opened
    opened.close()


def _kept(rows):
    return [(row["phase"], row["i"]) for row in read_rows(rows.file)]


@pytest.mark.parametrize("count", [0, 1, 3])
def test_the_last_phase_is_cut_to_its_first_rows_and_goes_on_from_there(rows, count):
    left = rows.keep("second", count)
    assert left == read_rows(rows.file)
    assert _kept(rows) == [("first", 0), ("first", 1), *(("second", i) for i in range(count))]
    rows.append({"phase": "second", "i": 9})
    rows.sync()
    assert _kept(rows)[-1] == ("second", 9)
    assert len(_kept(rows)) == 3 + count


def test_a_phase_that_has_not_begun_leaves_all_rows(rows):
    before = rows.file.read_bytes()
    assert len(rows.keep("third", 0)) == 5
    assert rows.file.read_bytes() == before


def test_rows_that_have_been_lost_are_told(rows):
    with pytest.raises(RunError, match=r"holds 3 rows of phase 'second', but .* saved after 4"):
        rows.keep("second", 4)
    assert len(_kept(rows)) == 5
