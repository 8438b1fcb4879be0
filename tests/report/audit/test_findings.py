"""An audit in numbers and words."""

import json

import numpy as np
import pytest
from support.audit_findings_made import NUMBERS, findings

from gril_jax.report.audit.page import ASKED


@pytest.mark.parametrize("how", ["gradient ascent", "one object moved", "targets pushed"])
def test_the_best_state_without_progress_is_found_wherever_it_is(how):
    found = findings(how)
    kind, scene, reward = found.best_unearned()
    assert (kind, reward) == (how, -0.05)
    assert scene.center.shape == (2, 2)


def test_a_success_is_not_without_progress():
    found = findings(None)
    rewards = found.audit.rewards._replace(alone=np.full((1, 2, 1, 2, 2), -0.7))
    found = found._replace(audit=found.audit._replace(rewards=rewards))
    kind, scene, reward = found.best_unearned()
    assert (kind, reward) == ("battery", -0.4)
    np.testing.assert_array_equal(scene.center, found.states.battery.scenes.center[0, 3])


def test_the_worst_pair_has_its_factor_progress_and_rewards():
    kind, sides = findings().worst_pair()
    (lesser, *_), (_, score, paid) = sides[0], zip(*sides, strict=True)
    assert (kind, score) == ("random", (0.0, 0.5))
    np.testing.assert_allclose(paid, (-0.4, -0.95))
    np.testing.assert_array_equal(lesser.center, findings().states.battery.scenes.center[0, 3])


def test_json_says_what_is_sound_and_null_where_nothing_is_defined():
    results = json.loads(json.dumps(findings().as_json(), allow_nan=False))
    assert results["order_accuracy"] == 0.98
    assert results["touch_share"] is None
    assert results["sound"] == {
        "order_accuracy": True, "hack_gap": False, "touch_share": False, "push_share": True,
    }  # fmt: skip
    assert results["factor_accuracy"].keys() == {
        "start", "success", "touched", "wrong place", "random"
    }  # fmt: skip
    assert results["alone_share"] == {"shoe <b>": 0.25}
    assert results["best_unearned_state"]["found_by"] == "gradient ascent"
    assert [o["name"] for o in results["worst_pair"]["lesser"]["objects"]] == ["goal", "shoe <b>"]
    assert results.keys() >= NUMBERS.keys()


def test_each_line_says_what_is_asked():
    lines = findings().in_words()
    assert len(lines) == len(ASKED) + 1
    assert lines[-1].split()[:2] == ["outbid_share", "0.010"]
    assert lines[0].split()[:2] == ["order_accuracy", "0.980"]
    assert "NOT SOUND" not in lines[0]
    assert "(above 0)" in lines[1]
    assert lines[1].endswith("NOT SOUND")


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("order_accuracy", 0.97, 0.969),
        ("hack_gap", 1e-6, 0.0),
        ("touch_share", 0.05, 0.051),
        ("push_share", -0.1, 0.71),
    ],
)
def test_bounds(name, good, bad):
    assert ASKED[name].holds(good)
    assert not ASKED[name].holds(bad)
    assert not ASKED[name].holds(float("nan"))
