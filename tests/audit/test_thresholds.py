"""The thresholds of audits: what they hold of, and that the pages say them."""

import re
from pathlib import Path

import pytest

from gril_jax.audit.thresholds import TABLES, TASK, VIDEOS, Audited

DOCS = Path(__file__).parents[2] / "docs"
GOOD = {
    "touch_share": 0.0, "misranked_share": 0.0, "best_amiss_share": 0.7, "missing_share": 0.1,
    "tau": 0.9, "consistency": 0.02,
}  # fmt: skip


@pytest.mark.parametrize(
    ("table", "name", "good", "bad"),
    [
        (TASK, "order_accuracy", 0.97, 0.969),
        (TASK, "hack_gap", 1e-6, 0.0),
        (TASK, "touch_share", 0.05, 0.051),
        (TASK, "push_share", -0.1, 0.71),
        (TASK, "misranked_share", 0.05, 0.051),
        (TASK, "success_kept", 0.98, 0.979),
        (VIDEOS, "best_amiss_share", 1.0, 1.001),
        (VIDEOS, "misranked_share", 0.02, 0.021),
    ],
)
def test_bounds(table, name, good, bad):
    assert table[name].holds(good)
    assert not table[name].holds(bad)
    assert not table[name].holds(float("nan"))


@pytest.mark.parametrize("name", VIDEOS)
def test_one_bad_figure_fails_the_audit_and_is_the_reason(name):
    assert Audited("videos", GOOD).passes
    one = VIDEOS[name]
    worse = one.limit + (0.1 if one.direction == "at most" else -0.1)
    found = Audited("videos", GOOD | {name: worse})
    assert found.faults == [name]
    assert found.sentence().startswith(f"Fails the audit of the videos alone: {one.words}: ")
    assert f"{one.bound} is asked ({one.unit})" in found.sentence()
    (line,) = [line for line in found.lines() if line.endswith("FAILS")]
    assert line.startswith(name)
    assert found.as_json()["passes"] == {other: other != name for other in VIDEOS}


def test_the_verdict_names_the_kind_that_misranks_most():
    good = {name: one.limit + (one.direction == "above") for name, one in TASK.items()}
    found = Audited("task", good, "just outside")
    assert found.sentence() == "Passes its audit: all 6 figures keep their thresholds."
    found = Audited("task", good | {"misranked_share": 0.4}, "just outside")
    assert found.faults == ["misranked_share"]
    assert "falls short, just outside: 0.4, but at most 0.05 is asked" in found.sentence()
    assert "just outside   FAILS" in found.lines()[4]


def test_figures_of_training_are_left_out_if_a_reward_does_not_tell_them():
    found = Audited("videos", GOOD | {"tau": None, "consistency": None})
    assert found.passes
    assert found.table.keys() == VIDEOS.keys() - {"tau", "consistency"}
    assert Audited("videos", GOOD | {"touch_share": None}).faults == ["touch_share"]


@pytest.mark.parametrize("page", ["audit.md", "metrics.md"])
def test_pages_say_the_thresholds(page):
    text = (DOCS / page).read_text()
    rows = re.findall(r"^\| `(\w+)`.*?\| ([^|]*) \|$", text, re.MULTILINE)
    for table in TABLES.values():
        for name, one in table.items():
            assert (name, one.bound) in rows, f"{page} lacks {name}: {one.bound}"
