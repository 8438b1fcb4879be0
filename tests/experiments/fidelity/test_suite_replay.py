"""Replays of MAGICAL's other tasks: figures of made-up and of human actions, and wrong files."""

import json

import pytest
from gril_jax.experiments.fidelity import suite_replay as replay
from support import scenes

from gril_jax.errors import DemoError


def _file(path, films):
    whole = {n: {"frames": len(a) + 1, "score": 1.0, "actions": a} for n, a in films.items()}
    path.write_text(json.dumps(whole))
    return path


def test_actions_are_read_by_task_in_order(tmp_path):
    path = _file(tmp_path / "a.json", {"make-line/001": [3, 4], "make-line/000": [1, 2]})
    assert replay.load(path, ("make_line",))["make_line"].tolist() == [[1, 2], [3, 4]]


def test_driving_into_the_region_succeeds_and_standing_does_not(tmp_path, capsys):
    turn = [6] * 4 + [1] * 10 + [0] * 3
    path = _file(tmp_path / "a.json", {"move-to-region/0": [0] * 17, "move-to-region/1": turn})
    assert replay.main([str(path), "--tasks", "move_to_region", "--moved", "1"]) == 0
    found = json.loads(capsys.readouterr().out)["move_to_region"]
    assert found["scores"] == [0.0, 1.0]
    assert (found["score_1"], found["mean_score"]) == (1, 0.5)
    assert found["moved_starts"] == {"score_1": [1], "mean_score": 0.5}


def test_human_actions_of_the_short_tasks_succeed():
    """Those with few contacts; contacts of the others are for chance to decide."""
    path = scenes.shared_data() / "magical_suite" / "recorded.json"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    for task, actions in replay.load(path, ("move_to_region", "fix_colour")).items():
        assert replay.measure(task, actions[:6], moved=0)["score_1"] == 6


@pytest.mark.parametrize(
    ("films", "tasks", "words"),
    [
        ({}, ("make_line",), "has 0 demonstrations of make_line"),
        ({"make-line/0": [1], "make-line/1": [1, 2]}, ("make_line",), "2 demonstrations"),
        ({}, ("match_regions",), "'match_regions' is no task to replay"),
    ],
)
def test_wrong_files_are_one_sentence(tmp_path, films, tasks, words):
    with pytest.raises(DemoError, match=words) as error:
        replay.load(_file(tmp_path / "a.json", films), tasks)
    assert "\n" not in str(error.value)
    with pytest.raises(DemoError, match="must be a JSON file"):
        replay.load(tmp_path / "none.json", tasks)
