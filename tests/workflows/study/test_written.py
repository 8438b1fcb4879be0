"""Lines as CSV and as Markdown, beside plain sums over them."""

import csv as csv_format

import numpy as np
import pytest

from gril_jax.workflows.study.written import (
    SEEDS,
    Column,
    Section,
    cells,
    csv,
    markdown,
    mean_interval,
    mean_range,
    median_reached,
    with_published,
)

COLUMNS = ("row", "seed", "tau", "success", "steps")


def _lines(count=6, row="ours, audited"):
    draw = np.random.default_rng(0)
    return [
        {"row": row, "seed": seed}
        | dict(zip(COLUMNS[2:], draw.uniform(size=3).tolist(), strict=True))
        for seed in range(count)
    ]


def test_a_stranger_reads_it_by_its_columns():
    found = list(csv_format.DictReader(csv(_lines(), COLUMNS).splitlines()))
    assert [line["row"] for line in found] == ["ours, audited"] * 6
    assert float(found[2]["success"]) == pytest.approx(_lines()[2]["success"], rel=1e-5)


def test_what_is_not_known_is_empty():
    lines = _lines(3)
    lines[1]["tau"], lines[2]["tau"] = float("nan"), None
    del lines[0]["success"]
    found = list(csv_format.DictReader(csv(lines, COLUMNS).splitlines()))
    assert [line["tau"] for line in found][1:] == ["", ""]
    assert found[0]["success"] == ""


def test_published_numbers_stand_in_the_lines_of_their_row():
    lines = [*_lines(1, "a"), *_lines(1, "b")]
    found = with_published(lines, {"success": {"a": 85.0}})
    assert [line.get("published success") for line in found] == ["85.0", None]


def test_an_undefined_number_is_counted_and_not_averaged():
    x = np.array([0.5, 0.25])
    assert mean_range(x, 2) == "0.375 (0.250 to 0.500)"
    assert mean_range(x, 3) == "0.375 (0.250 to 0.500; 1 undefined)"


def test_the_interquartile_mean_leaves_the_ends_out_and_lies_in_its_interval():
    values = np.array([0.0, 0.25, 0.5, 0.85])
    text = mean_interval()(values, 4)
    assert text.startswith("0.400; 0.375 (")
    low, high = (float(x) for x in text.split("(")[1].split(")")[0].split(" to "))
    assert 0.0 <= low < 0.375 < high <= 0.85
    assert mean_interval(middle=False)(values, 4) == text.replace("; 0.375", "")
    assert mean_interval(digits=1, unit=100.0)(np.ones(2), 2) == "100.0; 100.0 (100.0 to 100.0)"
    assert mean_interval(middle=False)(np.array([0.25]), 1) == "0.250"


def test_a_median_counts_those_that_never_got_there_as_the_slowest():
    for at, count, said in (
        ([4.0, 2.0], 3, "4.00 (2 of 3)"),
        ([2.0], 3, "never (1 of 3)"),
        ([1.0, 3.0], 2, "3.00 (2 of 2)"),
        ([1.0], 2, "never (1 of 2)"),
        ([], 5, "never (0 of 5)"),
    ):
        assert median_reached(unit=1.0, digits=2)(np.array(at), count) == said


def test_what_is_known_of_a_row_stands_in_its_cells():
    lines = [*_lines(2, "a"), *_lines(1, "b"), {"row": "not yet", "seed": 0, "tau": None}]
    del lines[2]["steps"]
    lines[0]["note"] = lines[1]["note"] = "said"
    soon = Column("steps", "steps", median_reached(unit=1.0, digits=0), among="success")
    found = cells(lines, [SEEDS, Column("note", "note"), Column("tau", "tau"), soon])
    tau = mean_range(np.array([line["tau"] for line in lines[:2]]), 2)
    assert found["a"][:3] == ["2", "said", tau]
    assert found["a"][3].endswith("(2 of 2)")
    assert found["b"][1] == ""
    assert found["b"][3] == "never (0 of 1)"
    assert found["not yet"] == ["1", "", "", ""]


def test_a_table_has_five_columns_at_most_and_none_that_no_row_has():
    columns = [Column(f"x{i}", f"head {i}") for i in range(7)]
    lines = [{"row": "a", "seed": 0} | {f"x{i}": 0.5 for i in range(6)}]
    text = markdown(lines, [Section("A caption.", columns), Section("Nothing.", columns[6:])])
    heads = [line for line in text.splitlines() if line.startswith("| |")]
    assert heads == ["| | head 0 | head 1 | head 2 | head 3 |", "| | head 4 | head 5 |"]
    assert text.startswith("A caption.\n\n| | head 0")
    assert text.count("\n| a | 0.500 (0.500 to 0.500) |") == 2
    assert "Nothing" not in text
