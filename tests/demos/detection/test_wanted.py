"""What is asked of a detector, and what is kept of what it found: a detector counts its calls."""

from types import SimpleNamespace

import numpy as np
import pytest
from support import colour_network
from support.odd_videos import encoded

from gril_jax.demos.detection import wanted as asking
from gril_jax.demos.detection.kept import Kept, chosen
from gril_jax.demos.detection.sightings import Sighting, best_of
from gril_jax.demos.detection.wanted import Wanted, prompted, wanted
from gril_jax.demos.formats import boxes_of
from gril_jax.demos.importing import import_videos
from gril_jax.demos.vision.timed import look
from gril_jax.errors import ConfigError, DemoError

CUP, MUG = (9.0, 9.0, 40.0, 40.0), (50.0, 9.0, 90.0, 40.0)


class Counting:
    """Sees a cup in every frame, another one less surely, and a hand in the first frame alone."""

    names, together = ("cup", "hand"), 4

    def __init__(self, key="one"):
        self.key, self.frames = key, 0

    def __call__(self, frames):
        first = self.frames == 0
        self.frames += len(frames)
        cups = [Sighting("cup", MUG, 0.25), Sighting("cup", CUP, 0.9)]
        hand = [Sighting("hand", CUP, 0.8)]
        return [cups + hand * (first and k == 0) for k in range(len(frames))]


@pytest.fixture
def films(tmp_path):
    return [look(encoded(tmp_path / f"{name}.mp4", frames=6)) for name in "ab"]


def asked(detector, most, score=0.3, named=True):
    return Wanted(detector, most, score, named)


def test_a_prompt_is_classes_and_how_many_of_each():
    assert prompted(" 2 cups,red hand ,\n3 x forks, ") == {"cups": 2, "red hand": 1, "forks": 3}


WRONG = {
    "": "detect names nothing; it must be classes",
    " , ;": "detect names nothing",
    "cup, hand, cup": "names 'cup' twice; '2 cup' is how",
    "90 cups": "asks for 90 cups, but 1 to 8",
    "0 cups": "asks for 0 cups",
    "cup, ha\x07nd": "detect: a class must be a name",
}


@pytest.mark.parametrize("prompt", WRONG)
def test_a_wrong_prompt_is_a_sentence(prompt):
    with pytest.raises(DemoError, match=WRONG[prompt]):
        wanted(prompt)


def test_what_cannot_go_together_is_said_before_any_model_is_loaded(tmp_path, monkeypatch):
    def no_work(*_):
        raise AssertionError("a model is loaded")

    monkeypatch.setattr(asking, "text_detector", no_work)
    monkeypatch.setattr(asking, "onnx_detector", no_work)
    for words, given in {
        "robot is 'arm', which is not detected: the classes are cup, hand": {"robot": ["arm"]},
        "class 'cup' is not one of the task's: goal, hand": {"classes": ["goal", "hand"]},
        "detect_score is 1.5, but must be above 0": {"score": 1.5},
        "names are of a detector in a file such as yolox_s.onnx": {"names": "coco.txt"},
    }.items():
        with pytest.raises(DemoError, match=words):
            wanted("cup, hand", **given)
    with pytest.raises(DemoError, match="detect_model says it twice"):
        wanted("yolox.onnx", model="owlv2")
    for words, given in {
        "boxes and detect are two sources": {"boxes": "colour", "detect": "cup"},
        "names is given, but not detect": {"names": "coco.txt"},
    }.items():
        with pytest.raises(DemoError, match=words):
            import_videos(tmp_path, **given)


def test_classes_of_a_file_may_be_chosen_and_must_be_there(tmp_path):
    model, names = tmp_path / "kitchen.onnx", tmp_path / "names.txt"
    model.write_bytes(colour_network.detector(64, 64))
    names.write_text("\n".join(colour_network.NAMES))
    found = wanted("2 cup, hand", model=str(model), names=names)
    assert (found.most, found.named, found.score) == ({"cup": 2, "hand": 1}, True, 0.3)
    every = wanted(str(model), names=names, robot=["hand"])
    assert ([*every.most], every.named) == ([*colour_network.NAMES], False)
    with pytest.raises(DemoError, match=r"has no class 'cups' among 4 \(cup\)"):
        wanted("cups", model=str(model), names=names)
    with pytest.raises(DemoError, match="robot is 'arm', which is not detected: the classes are c"):
        wanted(str(model), names=names, robot=["arm"])


def test_the_extra_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"torch, .* pip install 'gril-jax\[detect\]'"):
        wanted("cup")


def test_a_second_import_finds_nothing_again_but_may_choose_otherwise(tmp_path, films):
    detector, told = Counting(), []
    tell = lambda *at: told.append(at)  # noqa: E731
    first = Kept(tmp_path, asked(detector, {"cup": 1}))(films, tell)
    assert detector.frames == 12
    assert told[0] == (1, 12)
    assert told[-1] == (12, 12)
    again = Kept(tmp_path, asked(detector, {"cup": 2}))(films, tell)
    assert detector.frames == 12
    assert [one[:5] for one in again["b"]] == [one[:5] for one in first["b"]]
    one, _ = chosen(again, films, asked(detector, {"cup": 2}))
    two, _ = chosen(again, films, asked(detector, {"cup": 2}, 0.2))
    three, _ = chosen(again, films, asked(detector, {"cup": 1}, 0.2))
    assert [len(counted["b"]) for counted in (one, two, three)] == [6, 12, 6]
    assert {box.edges for box in three["b"]} == {CUP}
    other = Counting("another")
    Kept(tmp_path, asked(other, {"cup": 1}))(films[:1], tell)
    assert other.frames == 6


def test_what_is_kept_is_a_boxes_file_like_any_other(tmp_path, films):
    found = Kept(tmp_path, asked(Counting(), {"cup": 1}))(films, lambda *_: None)
    (tmp_path / "b.csv").write_bytes((tmp_path / "detected" / "b.csv").read_bytes())
    assert [one[:5] for one in boxes_of(films[1])] == [one[:5] for one in found["b"]]


def test_another_video_of_the_same_name_is_looked_at(tmp_path, films):
    detector = Counting()
    Kept(tmp_path, asked(detector, {"cup": 1}))(films, lambda *_: None)
    encoded(tmp_path / "a.mp4", frames=5)
    Kept(tmp_path, asked(detector, {"cup": 1}))([look(tmp_path / "a.mp4")], lambda *_: None)
    assert detector.frames == 17


def test_a_folder_of_theirs_is_left_alone(tmp_path, films):
    (tmp_path / "detected").mkdir()
    (tmp_path / "detected" / "a.csv").write_text("mine")
    with pytest.raises(DemoError, match=r"detected: is where boxes .* holds something else"):
        Kept(tmp_path, asked(Counting(), {"cup": 1}))
    assert (tmp_path / "detected" / "a.csv").read_text() == "mine"


def test_classes_that_nobody_named_must_be_seen_often(tmp_path, films):
    found = Kept(tmp_path, asked(Counting(), {}))(films, lambda *_: None)
    every = asked(Counting(), {"cup": 8, "hand": 8}, named=False)
    counted, rare = chosen(found, films, every)
    assert rare == ["hand"]
    assert {one.name for one in counted["a"]} == {"cup"}


def test_a_class_that_is_nowhere_and_a_video_without_any_are_a_sentence(tmp_path, films):
    found = Kept(tmp_path, asked(Counting(), {}))(films, lambda *_: None)
    with pytest.raises(DemoError, match=r"no 'spoon' is in any video .* \(nothing is like it\)"):
        chosen(found, films, asked(Counting(), {"cup": 1, "spoon": 1}))
    with pytest.raises(DemoError, match=r"score of 0.95 or more \(the best score is 0.9\); lower"):
        chosen(found, films, asked(Counting(), {"cup": 1}, 0.95))
    with pytest.raises(DemoError, match=r"b.mp4: nothing of hand was found in any frame with a"):
        chosen(found, films, asked(Counting(), {"hand": 1}))


def test_boxes_are_cut_at_the_frame_and_what_is_no_number_is_no_box():
    edges = np.array([[-5, 2, 30, 40], [np.nan, 0, 9, 9], [50, 5, 50.5, 9]])
    found = best_of(edges, np.array([[0.9], [0.8], [0.7]]), ["cup"], 20, 30)
    assert found == [Sighting("cup", (0, 2, 20, 30), 0.9)]
    assert best_of(np.zeros((0, 4)), np.zeros((0, 1)), ["cup"], 20, 30) == []


def test_the_words_say_which_detector_and_score():
    found = asked(SimpleNamespace(key="yolox.onnx, YOLOX, sha256 1"), {"cup": 1})
    assert found.words == "boxes by yolox.onnx, of a score of 0.3 or more"
