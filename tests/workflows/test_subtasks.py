"""`gril subtasks`: scores against loops, cut sets, what it refuses, and a whole run."""

import io
import json
from typing import NamedTuple

import numpy as np
import pytest

from gril_jax.cli import main
from gril_jax.config.run_config import StageOptions
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.files import write_demo_set
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import RunError
from gril_jax.runs.progress import Progress
from gril_jax.workflows import subtask_ends as stage_ends
from gril_jax.workflows import subtask_report as subtask_report

STAGES = [{"lid": 20, "A": 60, "B": 40}, {"lid": 10, "A": 30, "B": -1}]


def _entry(name="x", stages=None, frames=80):
    return Demo(
        name, lambda: None, Tracks(np.zeros((frames, 1, 2)), None, None, None), 0, "success", stages
    )


def test_scores_count_what_is_met_once_and_in_order():
    found = [np.array([24, 40, 55, 70]), np.array([12, -1, -1, -1])]
    one = stage_ends.scores(found, STAGES, 5)
    assert one["all_found"] == 0.5
    assert (one["precision"], one["recall"]) == (4 / 5, 4 / 5)
    assert one["false"] == 0.5
    assert one["right_count"] == 0.0
    assert one["errors"] == {"lid": 3.0, "A": -5.0, "B": 0.0}
    assert one["median_error"] == 3.0


def test_scores_of_nothing_found_are_zero_and_the_error_is_unknown():
    one = stage_ends.scores([np.full(4, -1)], STAGES[:1], 5)
    assert (one["recall"], one["false"], one["errors"]["lid"]) == (0.0, 0.0, None)
    assert np.isnan(one["median_error"])


def _alone(*counts):
    return np.array([[*range(n), *[-1] * (6 - n)] for n in counts])


def test_films_that_disagree_on_the_number_of_stages_cast_doubt():
    said = stage_ends.doubt(_alone(3, 3, 2, 3, 4), [True] * 5, 3)
    assert said.startswith(
        "doubtful: only 3 of 5 held-out demonstrations show 3 ends by themselves"
    )
    assert "and the others 2 to 4, so" in said
    assert stage_ends.doubt(_alone(3, 3, 2, 3, 3), [True] * 5, 3) is None


def test_films_that_were_trained_on_cast_no_doubt_unless_there_are_no_others():
    alone = _alone(3, 1, 1, 1)
    assert stage_ends.doubt(alone, [True, False, False, False], 3) is None
    assert "only 1 of 4" in stage_ends.doubt(alone, [False] * 4, 3)


def _saved(folder, lengths=(30, 40)):
    made = []
    for number, count in enumerate(lengths):
        center = np.zeros((count, 1, 2), np.float32)
        center[:, 0, 0] = np.arange(count) / count
        tracks = Tracks(
            center, np.full_like(center, 0.1), np.zeros(1, np.int32), np.ones((count, 1), bool)
        )
        frames = np.full((count, 16, 16, 3), 200, np.uint8)
        stages = {"one": 9, "two": count - 5}
        made.append(Demo(f"d{number}", frames, tracks, 0, "success", stages))
    options = {"task": "tidy", "classes": ("cup",), "half_extent": 1.0, "fps": 10.0, "source": "-"}
    write_demo_set(folder, made, **options)
    return load_demo_set(folder)


def test_a_subtask_begins_where_the_one_before_ends_and_the_last_ends_with_the_film(tmp_path):
    demos = _saved(tmp_path / "set")
    ends = np.array([[10, 24], [12, 30]])
    with Progress(stream=io.StringIO()) as progress:
        stage_ends.write_sets(tmp_path, demos, demos.demos, ends, progress)
    first, last = (load_demo_set(tmp_path / f"subtask-{n}") for n in (1, 2))
    assert [len(e) for e in first] == [11, 13]
    assert [len(e) for e in last] == [20, 28]
    np.testing.assert_array_equal(last[0].tracks.center, demos[0].tracks.center[10:])
    assert first[0].stages == {"one": 9, "two": -1}
    assert last[0].stages == {"one": -1, "two": 15}
    assert first.source.startswith("subtask 1 of 2 of: ")


def _traces(reward, held_out=None):
    entries = [_entry(f"d{i}") for i in range(len(reward))]
    length = np.full(len(reward), reward.shape[1], np.int32)
    return subtask_report.Traces(entries, held_out or [True] * len(reward), reward, length)


def test_fewer_than_two_stages_is_a_sentence_that_names_the_options(tmp_path):
    rule = vars(StageOptions("run", patience=9))
    words = "1 of the stages' ends .* try a lower --prominence .*, --patience .it was 9."
    with pytest.raises(RunError, match=words):
        subtask_report._require_stages(tmp_path, rule, 1)
    subtask_report._require_stages(tmp_path, rule, 2)


def test_a_figure_marks_found_ends_and_true_ends():
    reward = np.linspace(-1, 0, 40).astype(np.float32)
    frames = np.zeros((40, 16, 16, 3), np.uint8)
    stages = {"lid": 8, "A": 30, "never": -1}
    figure = subtask_report.stages_figure(
        reward, np.array([10, 32]), frames, stages=stages, name="x"
    )
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert {"lid", "A", "1", "2"} <= set(texts)
    assert "never" not in texts


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--prominence", "0"], "--prominence is 0.0, but must be above 0"),
        (["--smoothing", "4"], "--smoothing is 4, but must be odd"),
        (["--patience", "0"], "--patience is 0, but must be at least 1"),
        (["--support", "2"], "--support is 2.0, but must be above 0 and at most 1"),
    ],
)
def test_a_knob_out_of_range_has_exit_code_2(tmp_path, capsys, args, words):
    assert main.main(["subtasks", str(tmp_path), *args]) == 2
    assert words in capsys.readouterr().err


def test_a_folder_that_is_no_run_is_one_sentence(tmp_path, capsys):
    assert main.main(["subtasks", str(tmp_path)]) == 2
    assert "has no config.yaml" in capsys.readouterr().err


class _Demos(NamedTuple):
    demo_set: object
    names: dict


def test_a_report_has_scores_segments_and_figures(tmp_path, monkeypatch):
    demos = _saved(tmp_path / "set", lengths=(90, 90, 90))
    step = np.concatenate([np.full(10, -1.0), np.full(75, -0.5), np.zeros(5)]).astype(np.float32)
    entries = [e for e in demos]
    traces = subtask_report.Traces(
        entries, [False, False, True], np.tile(step, (3, 1)), np.full(3, 90, np.int32)
    )
    monkeypatch.setattr(subtask_report.run_dir, "read_config", lambda folder: None)
    monkeypatch.setattr(subtask_report, "_demos", lambda *args: _Demos(demos, {}))
    monkeypatch.setattr(subtask_report, "traces_of", lambda *args: traces)
    said = []
    subtask_report.main(
        tmp_path, tmp_path / "out", StageOptions("run", smoothing=1, patience=4), echo=said.append
    )
    report = json.loads((tmp_path / "out" / "subtasks.json").read_text())
    assert report["demonstrations"]["d2"]["ends"] == [10, 85]
    assert report["demonstrations"]["d2"]["segments"] == [[0, 10], [10, 89]]
    assert report["scores"]["agreed"]["recall"] == 1.0
    assert report["tolerance"] == 10
    assert (tmp_path / "out" / "d2.png").stat().st_size > 1000
    assert said[0] == "2 stages, which end at rewards of -0.50, 0.00"
    assert report["doubt"] is None
    assert not any("doubtful" in line for line in said)


def test_segments_are_a_table_and_films_of_their_own(tmp_path):
    demos = _saved(tmp_path / "set")
    found = {
        "d0": {"segments": [(0, 10), (10, 29)], "found": [True, False], "split": "train"},
        "d1": {"segments": [(0, 12), (12, 39)], "found": [True, True], "split": "validation"},
    }
    rows = stage_ends.as_csv(found, demos).splitlines()
    assert rows[0] == ",".join(stage_ends.COLUMNS)
    assert rows[2:4] == ["d0,2,10,29,1.0,2.9,0,train", "d1,1,0,12,0.0,1.2,1,validation"]
    with Progress(stream=io.StringIO()) as progress:
        stage_ends.write_videos(tmp_path / "videos", found, demos, progress)
    films = sorted((tmp_path / "videos").iterdir())
    assert [film.name for film in films] == ["d0-1.mp4", "d0-2.mp4", "d1-1.mp4", "d1-2.mp4"]
    assert [len(read_video(film)) for film in films] == [11, 20, 13, 28]
