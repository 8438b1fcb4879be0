"""The table of a study: its cells beside plain sums, and what is left out."""

import numpy as np
import pytest

from gril_jax.workflows.study.table import (
    Column,
    Section,
    markdown,
    mean_range,
    median_reached,
    parts,
    percent,
    score,
    share,
    solved,
)


def test_an_undefined_number_is_counted_and_not_averaged():
    x = np.array([0.5, 0.25])
    assert mean_range(x, 2) == "0.375 (0.250 to 0.500)"
    assert mean_range(x, 3) == "0.375 (0.250 to 0.500; 1 undefined)"


def test_the_interquartile_mean_leaves_the_ends_out_and_lies_in_its_interval():
    values = np.array([0.0, 0.25, 0.5, 0.85])
    text = score(values, 4)
    assert text.startswith("0.400; 0.375 (")
    low, high = (float(x) for x in text.split("(")[1].split(")")[0].split(" to "))
    assert 0.0 <= low < 0.375 < high <= 0.85
    assert share(values, 4) == text.replace("; 0.375", "")
    assert percent(np.ones(2), 2) == "100.0; 100.0 (100.0 to 100.0)"
    assert share(np.array([0.25]), 1) == "0.250"


@pytest.mark.parametrize(
    ("at", "count", "said"),
    [
        ([4.0, 2.0], 3, "4.00 (2 of 3)"),
        ([2.0], 3, "never (1 of 3)"),
        ([1.0, 3.0], 2, "3.00 (2 of 2)"),
        ([], 5, "never (0 of 5)"),
    ],
)
def test_a_median_counts_those_that_never_got_there_as_the_slowest(at, count, said):
    assert median_reached(1e6 * np.array(at), count) == said


def test_of_a_single_start_it_is_told_who_solves_it():
    assert solved(np.array([0.999, 1.0]), 2) == "1 of 2 policies succeed"  # not in each of many


def test_what_is_known_of_a_row_stands_in_its_cells_beside_what_is_published():
    lines = [
        {"row": "a", "seed": 0, "tau": 0.25, "steps": 2e6, "success": 0.0, "published tau": "0.9"},
        {"row": "a", "seed": 1, "tau": 0.5, "steps": 3e6, "success": 0.0, "published tau": "0.9"},
        {"row": "b", "seed": 0, "tau": float("nan"), "success": 0.0},
        {"row": "not yet", "seed": 0, "tau": None},
    ]
    soon = Column("steps", "soon", median_reached, among="success")
    (found,) = parts(lines, [Section("A caption.", [Column("tau", "order"), soon])])
    assert found.headings == ["published tau", "order", "soon"]
    assert found.cells == {
        "a": ["0.9", mean_range(np.array([0.25, 0.5]), 2), "3.00 (2 of 2)"],
        "b": ["", "", "never (0 of 1)"],
    }


def test_a_table_has_five_columns_at_most_and_none_that_no_row_has():
    columns = [Column(f"x{i}", f"head {i}") for i in range(7)]
    lines = [{"row": "a", "seed": 0} | {f"x{i}": 0.5 for i in range(6)}]
    chosen = [Section("A caption.", columns), Section("Nothing.", columns[6:])]
    text = markdown(parts(lines, chosen))
    heads = [line for line in text.splitlines() if line.startswith("| |")]
    assert heads == ["| | head 0 | head 1 | head 2 | head 3 |", "| | head 4 | head 5 |"]
    assert text.startswith("A caption.\n\n| | head 0")
    assert text.count("\n| a | 0.500 (0.500 to 0.500) |") == 2
    assert "Nothing" not in text
