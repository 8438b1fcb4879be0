"""Table I's page: every number of the table, its figures, and nothing from elsewhere."""

import re

import numpy as np
import pytest

from gril_jax.report.figures.curves import spread
from gril_jax.report.figures.style import png
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.table1.columns import COLUMNS, REWARD, page, sections
from gril_jax.workflows.study.table1.rows import PAPER
from gril_jax.workflows.study.written import cells, with_paper

SECTIONS = sections({})
LOOKS = {"cycle": [0.5, 0.5], "success": [[-1.0, 0.0]], "failure": [[-1.0, -0.9, -0.8]]}


@pytest.fixture(scope="module")
def found():
    draw = np.random.default_rng(0)
    lines = []
    for row in ("environmental", "ours audited"):
        for seed in range(3):
            values = draw.uniform(size=len(COLUMNS) - 2).tolist()
            line = {"row": row, "seed": seed} | dict(zip(COLUMNS[2:], values, strict=True))
            lines.append(line | {"steps_95": float("nan")})
            if row == "environmental":
                for name in REWARD:
                    del lines[-1][name]
    about = {"command": "gril table1", "demos_sha256": "abc", "packages": {"jax": "1.2"}}
    return Found(["environmental", "ours audited"], lines, [], {"ours audited": LOOKS}, about)


@pytest.fixture(scope="module")
def picture():
    return png(spread({"a": np.zeros(1)}, "x"))


def test_the_page_has_every_column_of_the_table_with_its_numbers(found, picture):
    text = page(found, picture)
    assert text.count("<table>") == len(SECTIONS)
    tables = re.findall("<table>(.*?)</table>", text, re.DOTALL)
    for section in SECTIONS:
        heads = [one.heading for one in section.columns]
        of = [t for t in tables if re.findall(r'<th scope="col">(.*?)</th>', t) == heads]
        wanted = cells(with_paper(found.lines, PAPER, 1), section.columns)
        for row, texts in wanted.items():
            plain = [re.sub(r"; | (?=\()", "", cell, count=1) for cell in texts]
            rows = [re.search(rf'<th scope="row">{row}</th>(.*?)</tr>', t)[1] for t in of]
            shown = [re.sub("</?small>|<td>", "", r).split("</td>")[:-1] for r in rows]
            assert plain in shown
    assert "<small>(0 of 3)</small>" in text


def test_the_page_shows_every_row_and_loads_nothing(found, picture):
    text = page(found, picture)
    for word in ("ours audited", "the paper has 85.0%", "gril table1", "abc", "| | policies |"):
        assert word in text
    assert text.count("<img") == 3
    assert "http" not in text.replace("http-equiv", "")
    bare = page(found._replace(profiles={"a": LOOKS | {"failure": []}}), picture)
    assert "there are no failed demonstrations" in bare
