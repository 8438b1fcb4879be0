"""Table I's page: every number of the table in one of four tables."""

import re

import numpy as np
from gril_jax.experiments.table1.page import page
from gril_jax.experiments.table1.table import COLUMNS, columns


def _lines(seeds=3):
    draw = np.random.default_rng(0)
    found = []
    for row in ("environmental", "ours audited"):
        for seed in range(seeds):
            values = draw.uniform(size=len(COLUMNS) - 2).tolist()
            line = {"row": row, "seed": seed} | dict(zip(COLUMNS[2:], values, strict=True))
            found.append(line | {"steps_95": float("nan")})
            if row == "environmental":
                for name in COLUMNS[-4:]:
                    del found[-1][name]
    return found


def test_the_page_has_every_column_of_the_table_with_its_numbers():
    text = page(_lines(), "", b"figure", {}, {})
    assert text.count("<table>") == 4
    heads = re.findall(r'<th scope="col">(.*?)</th>', text)
    of = columns(_lines())
    assert sorted(heads) == sorted(["seeds", *of])
    for row in ("environmental", "ours audited"):
        parts = re.findall(rf'<th scope="row">{row}</th>(.*?)</tr>', text)
        cells = "".join(parts).replace("<td>", "").split("</td>")[:-1]
        shown = dict(zip(heads, cells, strict=True))
        assert shown.pop("seeds") == "3"
        for head, cell in shown.items():
            wanted = re.sub(r"; | (?=\()", "", of[head][row], count=1)
            assert re.sub("</?small>", "", cell) == wanted
    assert "<small>(0 of 3)</small>" in text
