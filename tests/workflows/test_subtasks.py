"""`gril subtasks`: scores against loops, cut sets, what it refuses, and a whole run."""

import io
import json
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from gril_jax.cli import main
from gril_jax.config.run_config import StageOptions
from gril_jax.demos.demo import Demo, Source, Tracks
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.files import write_demo_set
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import RunError
from gril_jax.runs.progress import Progress
from gril_jax.workflows.subtasks import doubts as subtask_doubts
from gril_jax.workflows.subtasks import ends as stage_ends
from gril_jax.workflows.subtasks import report as subtask_report

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
    said = subtask_doubts.doubt(_alone(3, 3, 2, 3, 4), [True] * 5, 3)
    assert said.startswith(
        "doubtful: only 3 of 5 held-out demonstrations show 3 ends by themselves"
    )
    assert "and the others 2 to 4, so" in said
    assert "show 1 end by themselves" in subtask_doubts.doubt(_alone(1, 2, 2), [True] * 3, 1)
    assert subtask_doubts.doubt(_alone(3, 3, 2, 3, 3), [True] * 5, 3) is None


def _stages(**changes):
    """Three demonstrations of 40 frames, which rise at frames 10 and 30."""
    reward = np.select([np.arange(40) < 10, np.arange(40) < 30], [-1.0, -0.5], 0.0)
    one = {
        "reward": np.tile(reward, (3, 1)), "ends": np.tile([10, 30], (3, 1)),
        "found": np.ones((3, 2), bool), "alone": np.tile([10, 30, -1], (3, 1)),
        "level": np.array([-0.5, 0.0]), "prominence": 0.125, "fps": 10.0,
    }  # fmt: skip
    return subtask_doubts.Stages(**one | changes)


def test_videos_that_agree_are_not_doubted():
    assert subtask_doubts.of_demonstrations(_stages()) == [[], [], []]


def _changed(name, at, value):
    array = getattr(_stages(), name).copy()
    array[at] = value
    return {name: array}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (_changed("found", (2, 0), False), ["shows no end of stage 1 by itself"]),
        (
            _changed("reward", (2, slice(10, 20)), -0.8),
            ["ends stage 1 at a reward of -0.80, not -0.50"],
        ),
        (_changed("alone", (2, 2), 25), ["may end stage 1 at 2.5 s as well"]),
        (_changed("reward", (2, slice(38, 40)), -0.2) | _changed("alone", (2, 2), 38), []),
        (
            _changed("ends", (2, 0), 29) | _changed("alone", (2, 0), 29),
            ["takes 0.1 s for stage 2, not 2.0 s"],
        ),
    ],
)
def test_a_doubtful_video_is_named_with_its_reason(changes, words):
    *others, last = subtask_doubts.of_demonstrations(_stages(**changes))
    assert others == [[], []]
    assert last == words


def test_films_that_were_trained_on_cast_no_doubt_unless_there_are_no_others():
    alone = _alone(3, 1, 1, 1)
    assert subtask_doubts.doubt(alone, [True, False, False, False], 3) is None
    assert "only 1 of 4" in subtask_doubts.doubt(alone, [False] * 4, 3)


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


def test_no_stage_is_a_sentence_that_names_the_options_and_one_stage_is_a_task(tmp_path):
    rule = vars(StageOptions("run", patience=9))
    words = "agree on no end of a stage, .* try a lower --prominence .*, --patience .it was 9."
    with pytest.raises(RunError, match=words):
        subtask_report._require_stages(tmp_path, rule, 0)
    subtask_report._require_stages(tmp_path, rule, 1)
    words = subtask_report.in_words([-0.02])
    assert words == "1 stage, which ends at a reward of -0.02: a one-stage task"


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


@pytest.fixture
def reported(tmp_path, monkeypatch):
    """`gril subtasks` on three demonstrations whose reward rises at given frames; what it says."""
    demos = _saved(tmp_path / "set", lengths=(90, 90, 90))

    def report(*frames, **options):
        step = np.select([np.arange(90) < frame for frame in frames], np.linspace(-1, -0.5, 2)
                         [: len(frames)], 0.0).astype(np.float32)  # fmt: skip
        traces = subtask_report.Traces(
            [*demos], [False, False, True], np.tile(step, (3, 1)), np.full(3, 90, np.int32)
        )
        monkeypatch.setattr(subtask_report.run_dir, "read_config", lambda folder, demos: None)
        monkeypatch.setattr(subtask_report, "_demos", lambda *args: _Demos(demos, {}))
        monkeypatch.setattr(subtask_report, "traces_of", lambda *args: traces)
        said, rule = [], {"smoothing": 1, "patience": 4}
        chosen = StageOptions("run", **rule, **options)
        subtask_report.main(tmp_path, tmp_path / "out", chosen, echo=said.append)
        return said

    return report


def test_a_call_may_be_repeated_and_refined_and_leaves_the_files_of_others(reported, tmp_path):
    out = tmp_path / "out"
    reported(10, 85)
    (out / "mine.txt").write_text("notes")
    first = {p.name: p.read_bytes() for p in out.iterdir()}
    reported(10, 85, videos=True, sets=True)
    again = {p.name: p.read_bytes() for p in out.iterdir() if p.is_file()}
    assert again == first
    assert len([*(out / "videos").iterdir()]) == 6
    assert len(load_demo_set(out / "subtask-2")) == 3
    reported(10, 85)  # what is not asked for again stays
    assert len([*(out / "videos").iterdir()]) == 6
    assert not [*tmp_path.glob(".out.*")]


def test_sets_of_other_segments_are_left_alone_and_their_videos_go(reported, tmp_path):
    out = tmp_path / "out"
    reported(10, 85, videos=True)
    reported(10, 70)
    assert not [*(out / "videos").iterdir()]
    reported(10, 70, sets=True)
    with pytest.raises(RunError, match=r"subtask-1 is of other segments .* name a new folder"):
        reported(10, 85)
    report = json.loads((out / "subtasks.json").read_text())
    assert report["demonstrations"]["d0"]["ends"] == [10, 70]


def test_one_stage_is_called_that_and_written(reported, tmp_path):
    said = reported(50)
    assert said[0].endswith("a one-stage task")
    report = json.loads((tmp_path / "out" / "subtasks.json").read_text())
    assert report["demonstrations"]["d1"]["segments"] == [[0, 50]]


def test_a_report_has_scores_segments_and_figures(reported, tmp_path):
    said = reported(10, 85)
    report = json.loads((tmp_path / "out" / "subtasks.json").read_text())
    assert report["demonstrations"]["d2"]["ends"] == [10, 85]
    assert report["demonstrations"]["d2"]["segments"] == [[0, 10], [10, 85]]
    assert report["demonstrations"]["d2"]["video_segments"][1] == {
        "first_frame": 10, "last_frame": 85, "begin_s": 1.0, "end_s": 8.5,
    }  # fmt: skip
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
    video = {"first_frame": 3, "last_frame": 7, "begin_s": 0.1, "end_s": 0.2}
    for one, doubts in zip(found.values(), (["is long", "is late"], []), strict=True):
        one |= {"video_segments": [video] * 2, "doubts": doubts}
    rows = stage_ends.as_csv(found, demos).splitlines()
    assert rows[0] == ",".join(stage_ends.COLUMNS)
    assert rows[2:4] == [
        "d0,2,10,29,1.0,2.9,3,7,0.1,0.2,0,train,is long; is late",
        "d1,1,0,12,0.0,1.2,3,7,0.1,0.2,1,validation,",
    ]


def test_a_segment_has_the_frames_and_seconds_of_the_video_that_was_imported():
    demo = _entry()
    assert stage_ends.of_video(demo, (10, 24), 10.0)["end_s"] == 2.4
    source = Source(np.arange(80, dtype=np.int32) * 3, np.arange(80) / 10 + 0.013)
    found = stage_ends.of_video(replace(demo, source=source), (10, 24), 10.0)
    assert found == {"first_frame": 30, "last_frame": 72, "begin_s": 1.013, "end_s": 2.413}


def test_segments_can_be_cut_into_videos(tmp_path):
    demos = _saved(tmp_path / "set")
    names = "a/d", "a_d"  # which are two
    demos = replace(demos, demos=tuple(map(lambda d, n: replace(d, name=n), demos, names)))
    found = {"a/d": {"segments": [(0, 10), (10, 29)]}, "a_d": {"segments": [(0, 12), (12, 39)]}}
    with Progress(stream=io.StringIO()) as progress:
        stage_ends.write_videos(tmp_path / "videos", found, demos, progress)
    films = sorted((tmp_path / "videos").iterdir())
    assert [film.name for film in films] == [
        "a%2Fd-1.mp4", "a%2Fd-2.mp4", "a_d-1.mp4", "a_d-2.mp4"
    ]  # fmt: skip
    assert [len(read_video(film)) for film in films] == [11, 20, 13, 28]
