"""Videos without boxes become a set of demonstrations, on the command line and in Python."""

import json
import shutil

import numpy as np
import pytest
from support import colour_network, kitchen_films

from gril_jax.cli import main
from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.importing import import_videos

LOOK = {"fps": 10.0, "width": 160, "height": 120, "tempo": 3.0}


def gril(*args):
    return main.main([str(arg) for arg in args])


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Three videos, and a network that finds what they show."""
    folder = tmp_path_factory.mktemp("home")
    stories = kitchen_films.write_films(folder / "films", 3, **LOOK)
    for path in (folder / "films").glob("*.csv"):
        path.unlink()
    (folder / "kitchen.onnx").write_bytes(colour_network.detector(128, 160, "YOLOX in cells"))
    (folder / "names.txt").write_text("\n".join(colour_network.NAMES) + "\n")
    return folder, stories


def test_an_onnx_file_and_names_are_enough(home, capsys):
    folder, stories = home
    found = ("--detect", folder / "kitchen.onnx", "--names", folder / "names.txt")
    films = ("demos", "import-videos", folder / "films", *found, "--robot", "hand")
    assert gril(*films, "--out", folder / "mine") == 0
    said = capsys.readouterr()
    assert "boxes by kitchen.onnx, of a score of 0.3 or more" in said.out
    assert f"{sum(len(one.boxes) for one in stories.values())} frames (100%)" in said.err
    made = load_demo_set(folder / "mine")
    assert (made.classes, made.robots) == (("coaster", "cup", "hand", "spoon"), ("hand",))
    assert (folder / "mine" / "import.png").stat().st_size > 10_000
    assert (folder / "mine" / "import.txt").read_text().startswith("boxes by kitchen.onnx")
    for demo, told in zip(made, stories.values(), strict=True):
        cup = told.boxes[: len(demo), 0]
        true = ((cup[:, :2] + cup[:, 2:]) / 2 - [80, 60]) / 160 * [1, -1]
        off = np.linalg.norm(demo.tracks.center[:, 1] - true, axis=1)
        assert np.median(off) < 0.015  # of the picture's width


def test_classes_are_chosen_from_a_file_in_python_and_boxes_are_kept(home, tmp_path):
    folder, _ = home
    seen, frames = [], []
    given = {"detect": "cup, hand", "detect_model": str(folder / "kitchen.onnx"),
             "names": folder / "names.txt"}  # fmt: skip
    for told in (seen, frames):
        made = import_videos(
            folder / "films",
            robot="hand",
            detecting=lambda *at, told=told: told.append(at),
            **given,
        )
        assert made.classes == ("cup", "hand")
    assert (folder / "films" / "detected" / "kitchen_00.csv").exists()
    assert len(frames) == 3  # a call a video: nothing was found again
    for kept in (folder / "films" / "detected" / "counted").iterdir():  # to be corrected by hand
        shutil.copy(kept, tmp_path)
        shutil.copy(folder / "films" / f"{kept.stem}.mp4", tmp_path)
    beside = import_videos(tmp_path, robot="hand")
    assert (beside.classes, len(beside)) == (made.classes, len(made))
    for one, other in zip(beside.boxes, made.boxes, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_wrong_options_are_one_sentence_and_leave_nothing(home, capsys):
    folder, _ = home
    for options, words in {
        ("--detect", ""): "detect names nothing",
        ("--detect", "cup", "--boxes", "colour"): "",
        ("--detect", folder / "none.onnx"): "none.onnx: the model cannot be read",
        ("--detect", folder / "kitchen.onnx"): "has no names of its classes",
        ("--detect", "cup", "--detect-score", "2"): "--detect-score is 2.0, but must be",
        ("--detect", "cup, hand", "--robot", "arm"): "robot is 'arm', which is not detected",
    }.items():
        films = ("demos", "import-videos", folder / "films", *options, "--out", folder / "new")
        assert gril(*films) == 2, options
        (said,) = [one for one in capsys.readouterr().err.splitlines() if one.startswith("gril:")]
        assert words in said
        assert not (folder / "new").exists()


@pytest.mark.slow
def test_both_stages_are_found_in_videos_without_boxes(tmp_path):
    stories = kitchen_films.write_films(tmp_path / "films", width=320, height=240)
    for path in (tmp_path / "films").glob("*.csv"):
        path.unlink()
    (tmp_path / "kitchen.onnx").write_bytes(
        colour_network.detector(256, 320, "YOLOX in cells", note=True)
    )
    films = ("demos", "import-videos", tmp_path / "films", "--detect", tmp_path / "kitchen.onnx")
    assert gril(*films, "--robot", "hand", "--out", tmp_path / "mine") == 0
    assert gril("pretrain", "--demos", tmp_path / "mine", "--out", tmp_path / "run") == 0
    assert gril("subtasks", tmp_path / "run") == 0
    found = json.loads((tmp_path / "run" / "subtasks" / "subtasks.json").read_text())
    errors = []
    for name, one in found["demonstrations"].items():
        true = np.array(stories[name].ends) / stories[name].fps
        assert len(one["ends"]) == 2
        errors += np.abs(np.array(one["ends"]) / 10 - true).tolist()
    assert np.median(errors) <= 0.2
