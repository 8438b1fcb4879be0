"""Table I beside plain sums over its policies' curves and lines."""

import numpy as np
import pytest

from gril_jax.workflows.study.counted import Counted
from gril_jax.workflows.study.curves import Curve
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.table1.columns import COLUMNS, REWARD, policy, sections, text
from gril_jax.workflows.study.table1.rows import PAPER
from gril_jax.workflows.study.written import cells, with_paper

SCORES = COLUMNS[2:14]
COUNTED = {"demo": Counted(6, 1), "jitter": Counted(12, 12), "layout": Counted(6, 6)}
SECTIONS = sections(COUNTED)


def _lines(seeds=5):
    draw = np.random.default_rng(0)
    found = []
    for row in ("environmental", "ours audited"):
        for seed in range(seeds):
            values = dict(zip(COLUMNS[2:], draw.uniform(size=len(COLUMNS)).tolist(), strict=False))
            if row == "environmental":
                values = {k: v for k, v in values.items() if k not in REWARD}
            found.append({"row": row, "seed": seed} | values)
    return found


def test_a_policy_s_scores_are_means_over_the_last_tenth_and_its_times_the_first():
    draw, at = np.random.default_rng(0), np.arange(1.0, 21)
    scores = {name: draw.uniform(size=20) for name in (*SCORES, "success_ever")}
    success = np.linspace(0.0, 0.94, 20)
    curve = Curve(0, 0, None, 100 * at, 2.5 * at, scores | {"success_jitter_sampled": success})
    found = policy(curve)
    for name in SCORES:
        assert found[name] == pytest.approx(np.mean([curve.scores[name][i] for i in (18, 19)]))
    for level in (50, 80):
        first = next(i for i, x in enumerate(success) if x >= level / 100)
        assert found[f"steps_{level}"] == 100 * (first + 1)
        assert found[f"seconds_{level}"] == 2.5 * (first + 1)
    assert np.isnan(found["steps_95"])
    assert found["env_steps"] == 2000
    assert {*found} | {*REWARD} == {*COLUMNS[2:]}


def test_success_is_told_in_percent_beside_the_paper_s_number():
    lines = _lines()
    of = np.array([line["success_jitter_sampled"] for line in lines[5:]])
    found = cells(with_paper(lines, PAPER, 1), SECTIONS[0].columns)
    assert found["environmental"][:2] == ["5", "85.0"]
    assert found["ours audited"][:2] == ["5", ""]
    middle = np.sort(of)[1:4].mean()
    assert found["ours audited"][3].startswith(f"{100 * of.mean():.1f}; {100 * middle:.1f} (")


def test_every_rate_is_headed_by_its_starts_and_demo_is_solved_or_not():
    heads = [one.heading for i in (0, 2, 3) for one in SECTIONS[i].columns]
    assert heads[2:] == [
        "deterministic actions, 12 Jitter starts", "sampled actions, 12 Jitter starts",
        "deterministic actions, one Demo start",
        "sampled actions, 6 sampled episodes from one Demo start",
        "deterministic actions, 6 Layout starts", "sampled actions, 6 Layout starts",
    ]  # fmt: skip
    unknown = [one.heading for one in sections({})[0].columns[2:]]
    assert all(head.endswith("number of starts not recorded") for head in unknown)
    lines = [line | {"success": float(line["seed"] < 3)} for line in _lines()]
    found = cells(lines, SECTIONS[2].columns)
    assert found["ours audited"][0] == "solved by 3 of 5 policies"


def test_how_soon_is_written_for_policies_that_have_finished():
    lines = [*_lines(), {"row": "audited alone", "seed": 0, "tau": 0.5}]
    for line, value in zip(lines, [3e6, float("nan"), 1e6, 2e6, float("nan")], strict=False):
        line["steps_80"] = value
    found = cells(lines, SECTIONS[4].columns)
    assert found["environmental"][1] == "3.00 (3 of 5)"
    assert found["audited alone"] == ["", "", ""]


def test_the_markdown_has_every_section_and_says_what_made_it():
    about = {"command": "gril table1", "started": "today", "device": "1 x cpu"}
    about |= {"packages": {"jax": "1.2", "other": "3"}, "demos_sha256": "abc"}
    found = text(Found(["environmental", "ours audited"], _lines(), [], {}, about))
    assert found.count("\n| ours audited | ") == found.count("\n| | ") == len(SECTIONS)
    assert found.count("\n| environmental | ") == len(SECTIONS) - 1  # it learns no reward
    assert max(len(section.columns) for section in SECTIONS) <= 4
    assert found.splitlines()[-1] == (
        "`gril table1`, begun today on 1 x cpu; jax 1.2; demonstrations with SHA-256 abc."
    )
