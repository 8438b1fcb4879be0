"""Lines as CSV: what is written is read, and what is not known stays unknown."""

import csv

import numpy as np
import pytest
from gril_jax.experiments.sweeps import table_csv

COLUMNS = ("row", "seed", "tau", "success", "steps")


def _lines(count=6):
    draw = np.random.default_rng(0)
    return [
        {"row": "ours, audited", "seed": seed}
        | dict(zip(COLUMNS[2:], draw.uniform(size=3).tolist(), strict=True))
        for seed in range(count)
    ]


def test_lines_are_read_as_they_were_written():
    lines = _lines()
    lines[1]["tau"], lines[2]["tau"] = float("nan"), None
    del lines[3]["success"]
    text = table_csv.written(lines, COLUMNS)
    found = table_csv.read(text, COLUMNS)
    assert table_csv.written(found, COLUMNS) == text
    for line, again in zip(lines, found, strict=True):
        assert (again["row"], again["seed"]) == (line["row"], line["seed"])
        known = {k: x for k, x in line.items() if k in COLUMNS[2:] and x is not None and x == x}
        assert {k: x for k, x in again.items() if k in COLUMNS[2:]} == pytest.approx(known, 1e-5)


def test_a_stranger_reads_it_by_its_columns():
    found = list(csv.DictReader(table_csv.written(_lines(), COLUMNS).splitlines()))
    assert [line["row"] for line in found] == ["ours, audited"] * 6
    assert float(found[2]["success"]) == pytest.approx(_lines()[2]["success"], rel=1e-5)


def test_a_table_without_a_column_is_no_table():
    with pytest.raises(KeyError):
        table_csv.read(table_csv.written(_lines(), COLUMNS[:4]), COLUMNS)
