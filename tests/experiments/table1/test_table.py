"""Table I beside plain sums over its lines."""

import numpy as np
from gril_jax.experiments.table1.table import COLUMNS, columns, markdown, percent


def _lines(rows=("environmental", "ours audited"), seeds=5):
    draw = np.random.default_rng(0)
    found = []
    for row in rows:
        for seed in range(seeds):
            values = dict(zip(COLUMNS[2:], draw.uniform(size=len(COLUMNS)).tolist(), strict=False))
            if row == "environmental":
                values = {k: v for k, v in values.items() if k not in COLUMNS[-4:]}
            found.append({"row": row, "seed": seed} | values)
    return found


def test_success_is_told_in_percent_with_mean_and_interquartile_mean():
    lines = _lines()
    of = np.array([line["success_layout_sampled"] for line in lines[5:]])
    cell = columns(lines)["success, Layout starts, drawn actions, %"]["ours audited"]
    middle = np.sort(of)[1:4].mean()
    assert cell.startswith(f"{100 * of.mean():.1f}; {100 * middle:.1f} (")
    assert cell == percent(of)
    assert percent(np.array([1.0, 1.0])) == "100.0; 100.0 (100.0 to 100.0)"
    assert percent(np.array([])) == ""


def test_how_soon_is_a_median_of_which_those_that_never_get_there_come_last():
    lines = _lines(["a"])
    steps = [3e6, float("nan"), 1e6, 2e6, float("nan")]
    for line, value in zip(lines, steps, strict=True):
        line["steps_80"] = value
    assert columns(lines)["M env steps to 80 %"]["a"] == "3.00 (3 of 5)"
    lines[0]["steps_80"] = float("nan")
    assert columns(lines)["M env steps to 80 %"]["a"] == "never (2 of 5)"
    del lines[2]["steps_80"], lines[3]["steps_80"]
    assert columns(lines)["M env steps to 80 %"]["a"] == "never (0 of 5)"


def test_the_paper_s_number_and_the_audit_stand_where_a_row_has_them():
    table = columns(_lines())
    assert table["paper"] == {"environmental": "85.0", "ours audited": ""}
    gaps = [line["hack_gap_demo"] for line in _lines()[5:]]
    shown = f"{np.mean(gaps):.3f} ({min(gaps):.3f} to {max(gaps):.3f})"
    assert table["hack gap"] == {"environmental": "", "ours audited": shown}


def test_the_markdown_has_every_column_once_and_says_how_success_is_counted():
    lines = _lines()
    about = {"command": "gril table1", "started": "today", "device": "1 x cpu"}
    about |= {"packages": {"jax": "1.2", "other": "3"}, "demos_sha256": "abc"}
    text = markdown(lines, about, evaluations=2)
    heads = [cell for line in text.splitlines() if line.startswith("| |") for cell in _cells(line)]
    assert sorted(heads) == sorted(["seeds", *columns(lines)])
    assert text.count("\n| ours audited | ") == 3
    assert "in the last tenth of its training (2)" in text
    assert "From Demo starts nothing is drawn" in text
    assert text.splitlines()[-1] == (
        "`gril table1`, begun today on 1 x cpu; jax 1.2; demonstrations with SHA-256 abc."
    )


def _cells(line):
    return [cell.strip() for cell in line.strip("|").split("|")[1:]]
