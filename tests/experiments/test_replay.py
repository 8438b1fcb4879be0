"""The replay of human actions: its files, its figures, and how near it comes to the original."""

import gzip
import json
import pickle
import re

import numpy as np
import pytest
from gril_jax.experiments.fidelity import replay
from support import scenes

from gril_jax.errors import DemoError

FOLDER = scenes.shared_data() / "magical"


def test_errors_are_distances_over_the_first_steps():
    rng = np.random.default_rng(0)
    recorded = np.zeros((3, 13, 6, 3))
    recorded[:, 1:, :3, 0] = np.linspace(0.001, 0.5, 12)[:, None]  # robot and two blocks move
    places = recorded[:, 1:, :, :2] + rng.normal(size=(3, 12, 6, 2)) * 0.01
    found = replay._errors(places, recorded)
    apart = np.linalg.norm(places - recorded[:, 1:, :, :2], axis=-1)
    assert list(found) == ["first_10"]
    assert found["first_10"]["robot"]["median"] == round(float(np.median(apart[:, :10, 0])), 5)
    moved = apart[:, 1:10, 1:3]  # the first step is less than 0.01
    assert found["first_10"]["blocks"]["count"] == moved.size
    assert found["first_10"]["blocks"]["p95"] == round(float(np.percentile(moved, 95)), 5)


def test_blocks_stray_by_their_mean_distance_at_a_step():
    reference = np.zeros((3, 12, 6, 2))
    places = np.stack([reference, reference])
    places[0, :, 9, 1] = [0.3, 0.4]  # one of five blocks, in one of two replays
    places[:, :, 9, 0] = 7.0  # the robot
    places[:, :, 8] = 7.0  # another step
    assert replay._strayed(places, reference) == {"after_10": 0.05}


@pytest.mark.slow  # of recordings that a clean clone lacks
def test_first_steps_follow_the_original():
    """Free driving to 0.003, and blocks in the first 20 steps to 0.02 at the median."""
    if not FOLDER.is_dir():
        pytest.skip("no human demonstrations here")
    actions = {name: a[:20] for name, a in [*replay._of_folder(FOLDER).items()][:6]}
    with np.load(FOLDER / "replayed_states.npz") as file:
        recorded = np.stack([file[name][:21] for name in actions])
    found = replay.measure("match_regions", actions, recorded, moved=0)
    assert found["demonstrations"] == 6
    assert found["errors"]["first_10"]["robot"]["median"] < 1e-4
    assert found["errors"]["first_10"]["robot"]["p95"] < 0.01
    assert found["errors"]["first_20"]["blocks"]["median"] < 0.02
    assert set(found["scores"].values()) == {0.0}  # 20 steps bring nothing home


def _demo(path, actions):
    """A file with actions alone, which is all that the replay reads."""
    trajectory = (np.asarray(actions), [], [], [])
    path.write_bytes(gzip.compress(pickle.dumps({"trajectory": trajectory}, 4)))
    return path


def test_the_command_prints_figures_as_json(tmp_path, capsys, monkeypatch):
    _demo(tmp_path / "demo-x-007.pkl.gz", [1, 1])
    monkeypatch.setattr(replay.envs, "make", lambda *_, **__: None)
    places = np.zeros((2, 1, 2, 6, 2))
    monkeypatch.setattr(replay, "replay", lambda *_: (places, np.array([[1.0], [0.5]])))
    assert replay.main([str(tmp_path), "--moved", "1", "--iterations", "10"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["options"] == {"engine": "auto", "substeps": None, "iterations": 10}
    figures = printed["match_regions"]
    assert figures["scores"] == {"007": 1.0}
    assert (figures["score_1"], figures["mean_score"]) == (1, 1.0)
    assert figures["moved_starts"] == {"score_1": [0], "mean_score": 0.5, "strayed": {}}


def test_demonstrations_of_other_lengths_are_refused(tmp_path):
    _demo(tmp_path / "demo-x-000.pkl.gz", [1, 1])
    _demo(tmp_path / "demo-x-001.pkl.gz", [1])
    with pytest.raises(DemoError, match=r"differ in length \(000: 2, 001: 1\)"):
        replay._of_folder(tmp_path)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        (None, "does not exist"),
        (b"no archive", "is not a whole .npz"),
        ({"001": np.zeros((3, 6, 3))}, "has no poses of the demonstration 000"),
        ({"000": np.zeros((2, 6, 3))}, r"000 is \(2, 6, 3\), but must be \(3, 6, 3\)"),
    ],
)
def test_recorded_poses_of_another_form_are_one_sentence(tmp_path, capsys, arrays, words):
    _demo(tmp_path / "demo-x-000.pkl.gz", [1, 1])
    states = tmp_path / "states.npz"
    if isinstance(arrays, bytes):
        states.write_bytes(arrays)
    elif arrays is not None:
        np.savez(states, **arrays)
    assert replay.main([str(tmp_path), "--states", str(states)]) == 2
    message = capsys.readouterr().err
    assert message.startswith("replay: ")
    assert re.search(words, message)


def test_wrong_options_are_one_sentence(tmp_path, capsys):
    _demo(tmp_path / "demo-x-000.pkl.gz", [1, 1])
    for wrong, words in (("--moved=-1", "moved is -1"), ("--substeps=0", "substeps is 0")):
        assert replay.main([str(tmp_path), wrong]) == 2
        assert words in capsys.readouterr().err


# --- the other tasks


def _file(path, films):
    whole = {n: {"frames": len(a) + 1, "score": 1.0, "actions": a} for n, a in films.items()}
    path.write_text(json.dumps(whole))
    return path


def test_actions_are_read_by_task_in_order(tmp_path):
    path = _file(tmp_path / "a.json", {"make-line/001": [3, 4], "make-line/000": [1, 2]})
    found = replay.load(path, ("make_line",))["make_line"]
    assert [own.tolist() for own in found.values()] == [[1, 2], [3, 4]]


def test_driving_into_the_region_succeeds_and_standing_does_not(tmp_path, capsys):
    turn = [6] * 4 + [1] * 10 + [0] * 3
    path = _file(tmp_path / "a.json", {"move-to-region/0": [0] * 17, "move-to-region/1": turn})
    assert replay.main([str(path), "--tasks", "move_to_region", "--moved", "1"]) == 0
    found = json.loads(capsys.readouterr().out)["move_to_region"]
    assert [*found["scores"].values()] == [0.0, 1.0]
    assert (found["score_1"], found["mean_score"]) == (1, 0.5)
    assert found["moved_starts"]["score_1"] == [1]


def test_human_actions_of_the_short_tasks_succeed():
    """Those with few contacts; contacts of the others are for chance to decide."""
    path = scenes.shared_data() / "magical_suite" / "recorded.json"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    for task, actions in replay.load(path, ("move_to_region", "fix_colour")).items():
        assert replay.measure(task, dict([*actions.items()][:6]), moved=0)["score_1"] == 6


@pytest.mark.parametrize(
    ("films", "tasks", "words"),
    [
        ({}, ("make_line",), "has 0 demonstrations of make_line"),
        ({"make-line/0": [1], "make-line/1": [1, 2]}, ("make_line",), "make_line differ in length"),
        ({}, ("match_regions",), "'match_regions' is no task to replay"),
    ],
)
def test_wrong_files_are_one_sentence(tmp_path, films, tasks, words):
    with pytest.raises(DemoError, match=words) as error:
        replay.load(_file(tmp_path / "a.json", films), tasks)
    assert "\n" not in str(error.value)
    with pytest.raises(DemoError, match="must be a JSON file"):
        replay.load(tmp_path / "none.json", tasks)
