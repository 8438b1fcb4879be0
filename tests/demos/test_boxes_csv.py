"""Boxes from a CSV file in place of colour detection."""

import numpy as np
import pytest

from gril_jax.demos.boxes_csv import BoxesFileDetector
from gril_jax.demos.vision.detect import Detector
from gril_jax.errors import DemoError

CLASSES = ("goal", "robot", "cup")
HEADER = "frame,class,x_min,y_min,x_max,y_max\n"
GOAL = "0,goal,0,0,10,10\n"
FRAMES = np.zeros((4, 100, 200, 3), np.uint8)  # 200 pixels wide: 4 world units at 2.0


def detect(tmp_path, text, classes=CLASSES):
    path = tmp_path / "boxes.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return BoxesFileDetector(path, classes, 2.0).detect(FRAMES, name="a.mp4")


def test_it_is_a_detector(tmp_path):
    assert isinstance(BoxesFileDetector(tmp_path / "x.csv", CLASSES, 1.0), Detector)


def test_pixels_become_world_units_with_y_up_and_origin_in_the_middle(tmp_path):
    tracks = detect(tmp_path, HEADER + GOAL + "0,cup,150,0,200,50\n0,robot,90,45,110,55\n")
    assert tracks.label.tolist() == [0, 1, 2]
    np.testing.assert_allclose(tracks.center[0], [[-1.9, 0.9], [0.0, 0.0], [1.5, 0.5]], atol=1e-6)
    np.testing.assert_allclose(tracks.size[0], [[0.2, 0.2], [0.4, 0.2], [1.0, 1.0]], atol=1e-6)
    assert tracks.center.dtype == tracks.size.dtype == np.float32
    assert tracks.label.dtype == np.int32


def test_gaps_are_filled_with_the_last_box_and_beginnings_with_the_first(tmp_path):
    tracks = detect(tmp_path, HEADER + GOAL + "1,cup,10,10,20,20\n3,cup,30,10,40,20\n")
    assert tracks.seen[:, 1].tolist() == [False, True, False, True]
    assert tracks.seen[:, 0].tolist() == [True, False, False, False]
    x = tracks.center[:, 1, 0]
    assert x[0] == x[1] == x[2] != x[3]
    assert (tracks.center[:, 0] == tracks.center[0, 0]).all()


def test_columns_may_come_in_any_order_with_spaces_blank_lines_and_a_byte_order_mark(tmp_path):
    plain = detect(tmp_path, HEADER + GOAL + "0,cup,1,2,3,4\n")
    text = "\ufeffclass, frame ,y_max,x_max,y_min,x_min\n\n goal,0,10,10,0,0\ncup, 0, 4,3,2,1\n"
    np.testing.assert_array_equal(plain.center, detect(tmp_path, text).center)
    np.testing.assert_array_equal(plain.size, detect(tmp_path, text).size)


def test_further_columns_are_ignored(tmp_path):
    plain = detect(tmp_path, HEADER + GOAL + "0,cup,1,2,3,4\n")
    text = HEADER.replace("\n", ",confidence,note\n") + "0,goal,0,0,10,10,1,a\n0,cup,1,2,3,4,,\n"
    np.testing.assert_array_equal(plain.center, detect(tmp_path, text).center)


def test_a_vocabulary_without_goal_needs_no_goal(tmp_path):
    assert detect(tmp_path, HEADER + "0,cup,1,2,3,4\n", ("cup",)).label.tolist() == [0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", r"line 1: the columns must be frame,class,.* not an empty line\.$"),
        ("frame,class,x,y,w,h\n", r"line 1: the columns must be"),
        (HEADER, r"no rows below its header"),
        (HEADER + "0,cup,1,2,3,4\n", r"no row of class 'goal'"),
        (HEADER + GOAL + "0,cup,1,2,3\n", r"line 3: 5 cells where 6 are needed"),
        (HEADER + GOAL + "0,cup,1,2,3,4,5\n", r"line 3: 7 cells where 6 are needed"),
        (
            HEADER + GOAL + "0,cat,1,2,3,4\n",
            r"line 3: class 'cat' is not one of goal, robot, cup",
        ),
        (HEADER + GOAL + "0.5,cup,1,2,3,4\n", r"line 3: frame must be a whole number"),
        (HEADER + GOAL + "-1,cup,1,2,3,4\n", r"line 3: frame must be a whole number"),
        (HEADER + GOAL + "9" * 5000 + ",cup,1,2,3,4\n", r"line 3: frame must be a whole"),
        (HEADER + GOAL + "4,cup,1,2,3,4\n", r"line 3: frame 4 is beyond .* from 0 to 3"),
        (HEADER + GOAL + "0,cup,1,two,3,4\n", r"line 3: y_min must be a number, not 'two'"),
        (HEADER + GOAL + "0,cup,1,2,nan,4\n", r"line 3: x_max must be a number, not 'nan'"),
        (HEADER + GOAL + "0,cup,1,2,inf,4\n", r"line 3: x_max must be a number, not 'inf'"),
        (HEADER + GOAL + "0,cup,3,2,1,4\n", r"line 3: a box needs x_min < x_max"),
        (HEADER + GOAL + "0,cup,1,4,3,4\n", r"line 3: a box needs x_min < x_max and y_min"),
        (HEADER + GOAL + "0,goal,1,2,3,4\n", r"line 3: a second 'goal' in frame 0"),
        (b"\xff\xfe\x00\x01", r"not CSV text in UTF-8"),
    ],
)
def test_malformed_files_are_refused_with_file_line_and_remedy(tmp_path, text, words):
    with pytest.raises(DemoError, match=words) as caught:
        detect(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "boxes.csv"))
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DemoError, match=r"nothing\.csv: the boxes file cannot be read"):
        BoxesFileDetector(tmp_path / "nothing.csv", CLASSES, 1.0).detect(FRAMES)
