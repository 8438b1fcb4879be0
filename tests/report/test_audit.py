"""An audit in its run's report, in numbers and words, in pictures, and on a page of its own."""

import json

import numpy as np
import pytest
from matplotlib.patches import Rectangle
from support.audit_findings_made import NUMBERS, findings

from gril_jax.audit.scene_reward import Scene
from gril_jax.audit.thresholds import TASK
from gril_jax.errors import RunError
from gril_jax.report.audit_maps import Situation, reward_maps, state_pictures
from gril_jax.report.audit_page import write_report
from gril_jax.report.headline import audit_sentence, audit_tiles, verdict
from gril_jax.report.style import png

SOUND = {
    "order_accuracy": 0.999, "hack_gap": 0.5, "touch_share": 0.01, "push_share": 0.47,
    "misranked_share": 0.02, "success_kept": 0.995,
}  # fmt: skip
WORKED = {"tau": 0.8, "success": 1.0, "starts": 256, "variant": "jitter", "eval_episodes": 256}


def _results(**changes):
    return WORKED | {"audit": SOUND | changes}


def test_a_sound_reward_is_called_so_with_its_numbers():
    (tile,) = audit_tiles(_results())
    assert tile.value == "passes"
    assert tile.note == (
        "order 0.999 (at least 0.97); hack gap 0.50 (above 0); touch 0.01 (at most 0.05); "
        "push 0.47 (at most 0.7); misranked 0.02 (at most 0.05); success kept 0.99 (at least 0.98)"
    )
    assert verdict(_results()).grade == "good"
    assert audit_sentence(_results()) == f"audit: passes ({tile.note})"


@pytest.mark.parametrize(("name", "value"), [("hack_gap", -0.1), ("touch_share", None)])
def test_a_fault_or_an_unknown_number_is_not_sound_and_spoils_the_verdict(name, value):
    results = _results(**{name: value})
    (tile,) = audit_tiles(results)
    assert tile.value == "fails"
    assert f"FAILS, {TASK[name].bound}" in tile.note
    found = verdict(results)
    assert found.grade == "fair"
    assert found.text.endswith("But its reward fails its audit.")


def test_a_reward_without_an_audit_says_so_and_a_run_without_a_reward_has_no_tile():
    assert audit_tiles(WORKED)[0].value == "not audited"
    assert audit_sentence(WORKED).startswith("audit: none")
    assert audit_tiles({}) == []


def test_a_number_that_is_none_is_refused():
    with pytest.raises(RunError, match="audit: hack_gap must be a number"):
        audit_tiles(_results(hack_gap="high"))


# --- its findings


@pytest.mark.parametrize("how", ["gradient search", "one object moved", "targets pushed"])
def test_the_best_state_without_progress_is_found_wherever_it_is(how):
    found = findings(how)
    kind, scene, reward = found.best_unearned()
    assert (kind, reward) == (how, -0.05)
    assert scene.center.shape == (2, 2)


def test_a_kind_has_its_best_state_and_the_worst_kind_comes_first():
    found = findings("targets pushed")
    shortfalls = found.shortfalls()
    assert [*shortfalls] == ["intruder inside", "nothing done"]
    share, state = shortfalls["intruder inside"]
    assert (share, state.how, state.reward) == (0.5, "gradient search", -0.02)
    np.testing.assert_array_equal(state.scene.center, found.audit.found.scene.center[0, 1, 4])
    assert shortfalls["nothing done"][1].how == "targets pushed"
    assert found.worst_success()[1] == -0.25


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
    assert results["passes"] == {
        "order_accuracy": True, "hack_gap": False, "touch_share": False, "push_share": True,
        "misranked_share": False, "success_kept": True,
    }  # fmt: skip
    assert results["misranked"] == {"intruder inside": 0.5, "nothing done": 0.25}
    assert results["worst_kind"] == "intruder inside"
    assert results["worst_states"]["intruder inside"]["reward"] == -0.02
    assert results["factor_accuracy"].keys() == {
        "start", "success", "touched", "wrong place", "random"
    }  # fmt: skip
    assert results["alone_share"] == {"shoe <b>": 0.25}
    assert results["best_unearned_state"]["found_by"] == "gradient search"
    assert [o["name"] for o in results["worst_pair"]["lesser"]["objects"]] == ["goal", "shoe <b>"]
    assert results.keys() >= NUMBERS.keys()
    assert results["kind"] == "task"
    assert results["passed"] is False
    assert results["thresholds"]["hack_gap"]["direction"] == "above"
    assert results["thresholds"]["misranked_share"]["limit"] == 0.05


def test_each_line_says_what_is_asked_and_the_verdict_says_why():
    verdict, *lines = findings().in_words()
    assert len(lines) == len(TASK)
    assert lines[-1].split()[:5] == ["success_kept", "0.990", "(at", "least", "0.98;"]
    assert lines[0].split()[:2] == ["order_accuracy", "0.980"]
    assert "FAILS" not in lines[0]
    assert "(above 0; reward)" in lines[1]
    assert lines[1].endswith("FAILS")
    assert "-0.05, but above 0 is asked (reward)" in verdict
    assert "falls short, intruder inside: 0.5, but at most 0.05 is asked" in verdict


# --- pictures

CENTER = np.array([[0.5, 0.5], [-0.5, 0.0], [0.0, -0.5]])
SIZE = np.array([[0.6, 0.8], [0.2, 0.2], [0.4, 0.2]])
ACTIVE = np.array([False, True, False])
NAMES = ("goal", "shoe A", "shoe B")


SCENE = Scene(CENTER, SIZE, None, None, ACTIVE)


def test_a_map_shows_every_place_of_the_objects_centre_in_one_scale():
    reward = np.arange(18.0).reshape(2, 3, 3)
    situations = [Situation("at the start", SCENE, reward), Situation("later", SCENE, reward + 9)]
    figure = reward_maps(situations, NAMES, (1, 2), half_extent=1.0)
    maps = [axes for axes in figure.axes if axes.get_images()]
    assert [axes.get_title("left") for axes in maps] == ["shoe A", "shoe B"] * 2
    assert [axes.get_ylabel() for axes in maps] == ["at the start", "", "later", ""]
    image = maps[1].get_images()[0]
    np.testing.assert_allclose(image.get_extent(), [-0.8, 0.8, -0.9, 0.9])  # less its own box
    assert image.origin == "lower"
    np.testing.assert_array_equal(image.get_array(), reward[1])
    assert {axes.get_images()[0].get_clim() for axes in maps} == {(0.0, 26.0)}
    boxes = [p for p in maps[0].patches if isinstance(p, Rectangle)]
    corners = [p.get_xy() for p in boxes]
    np.testing.assert_allclose(corners, [(0.2, 0.1), (-0.2, -0.6)])  # not its own
    assert png(figure).startswith(b"\x89PNG")


def test_many_objects_take_several_rows():
    reward = np.zeros((8, 2, 2))
    figure = reward_maps([Situation("", SCENE, reward)], NAMES, [1] * 8, half_extent=1.0)
    assert sum(axes.get_visible() and bool(axes.get_images()) for axes in figure.axes) == 8


def test_boxes_of_a_state_look_different_however_many_there_are():
    crowd = Scene(np.zeros((12, 2)), np.ones((12, 2)), None, None, np.zeros(12, bool))
    figure = state_pictures([("", crowd)], [f"block {i}" for i in range(12)], half_extent=1.0)
    looks = {(p.get_edgecolor(), p.get_linestyle()) for p in figure.axes[0].patches}
    assert len(looks) == 12


def test_a_state_has_thick_boxes_where_bits_are_set():
    figure = state_pictures([("before", SCENE), ("after", SCENE)], NAMES, half_extent=1.0)
    assert [axes.get_title("left") for axes in figure.axes] == ["before", "after"]
    widths = [p.get_linewidth() for p in figure.axes[0].patches]
    assert widths[1] > widths[0] == widths[2]
    assert [t.get_text() for t in figure.legends[0].get_texts()] == list(NAMES)


# --- its page


def _write(folder, found):
    results = found.as_json() | {"settings": {"source": "<reward>", "seed": 3}}
    return write_report(folder, found, results, title="Audit of x")


def test_it_is_one_file_with_numbers_pictures_and_states(tmp_path):
    page = _write(tmp_path, findings())
    text = page.read_text()
    assert {p.name for p in tmp_path.iterdir()} == {
        "report.html", "worst.png", "maps.png", "worst_pair.png"
    }  # fmt: skip
    assert text.count("data:image/png;base64,") == 3
    assert "-0.050" in text
    assert "FAILS" in text
    assert "at least 0.97" in text
    assert "The worst kind of shortfall is &quot;intruder inside&quot;" in text
    assert "50.0% of 4 clear successes" in text
    assert "&lt;reward&gt;" in text
    assert "<reward>" not in text


def test_without_a_violation_no_pair_is_shown(tmp_path):
    found = findings()
    measures = found.audit.measures
    measures = measures._replace(worst_violation=measures.worst_violation * 0)
    page = _write(tmp_path, found._replace(audit=found.audit._replace(measures=measures)))
    assert "Every pair of states is in its true order" in page.read_text()
    assert not (tmp_path / "worst_pair.png").exists()


def test_without_a_clear_success_the_share_is_not_known_and_fails(tmp_path):
    found = findings()
    measures = found.audit.measures
    unknown = measures._replace(
        misranked=measures.misranked * np.nan, misranked_share=np.float32(np.nan)
    )
    states = found.states._replace(succeeds=np.zeros((1, 4), bool))
    found = found._replace(states=states, audit=found.audit._replace(measures=unknown))
    assert "misranked_share" in found.audited().faults
    assert found.as_json()["misranked"] == {"nothing done": None, "intruder inside": None}
    assert "0 clear successes" in _write(tmp_path, found).read_text()


def test_a_folder_that_is_gone_is_one_sentence(tmp_path):
    with pytest.raises(RunError, match="cannot be written to"):
        _write(tmp_path / "gone", findings())
