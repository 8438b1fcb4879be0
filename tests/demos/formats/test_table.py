"""A table gives the same boxes whichever spreadsheet, tool or shell wrote it."""

import pytest

from gril_jax.demos.formats import boxes_of
from gril_jax.demos.formats.fit import doubts, require_distinct, within
from gril_jax.demos.formats.record import Film
from gril_jax.errors import DemoError

FRAMES, W, H = 4, 64, 48
HEAD = "frame,class,x_min,y_min,x_max,y_max"
ROWS = [f"{t},cup,{t + 1.5},1,{t + 9.5},9" for t in range(FRAMES)]
PLAIN = "\n".join([HEAD, *ROWS, ""])


def film(folder, frames=FRAMES, size=(W, H)):
    return Film(folder / "a.mp4", [t / 10 for t in range(frames)], *size)


def read(folder, text, name="a.csv", **about):
    (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return boxes_of(film(folder, **about))


SAME = {
    "semicolons": PLAIN.replace(",", ";"),
    "tabs": PLAIN.replace(",", "\t"),
    "decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "quoted decimal commas": "\n".join(
        [HEAD, *(f'{t},cup,"{t + 1},5",1,"{t + 9},5",9' for t in range(FRAMES))]
    ),
    "Excel's first line": "sep=;\n" + PLAIN.replace(",", ";"),
    "UTF-16, as of PowerShell": PLAIN.encode("utf-16"),
    "a comment before": "# made by hand\n\n" + PLAIN,
    "comments and empty lines": PLAIN + "\n   \n# end\n,,,,,\n",
    "a comma at each end": PLAIN.replace("\n", ",\n"),
    "a comma at the end of rows": "\n".join([HEAD, *(f"{row},," for row in ROWS)]),
    "capitals and spaces": PLAIN.replace(HEAD, "Frame, Class, X_min, Y_min, X_max, Y_max"),
    "xmin": PLAIN.replace("x_", "x").replace("y_", "y"),
    "x1": PLAIN.replace(HEAD, "frame_id,label,x1,y1,x2,y2"),
    "from 1": "\n".join([HEAD, *(f"{t + 1}{row[1:]}" for t, row in enumerate(ROWS))]),
    "what is not seen": f"{PLAIN}1,hand,nan,NaN,,\n2,hand,,,,\n",
    "a class of number and name": "\n".join(
        ["class,frame,class_name,x_min,y_min,x_max,y_max", *(f"7,{row}" for row in ROWS)]
    ),
    "no confidence": "\n".join([f"{HEAD},confidence", *(f"{row},nan" for row in ROWS)]),
}


@pytest.mark.parametrize("kind", SAME)
def test_a_table_of_another_tool_is_the_same(tmp_path, kind):
    found = read(tmp_path, SAME[kind])
    assert [one[:4] for one in found] == [
        (t, "cup", (t + 1.5, 1.0, t + 9.5, 9.0), 1.0) for t in range(FRAMES)
    ]


def test_numbers_of_classes_are_those_of_the_names_file(tmp_path):
    (tmp_path / "Classes.TXT").write_text("hand\ncup\n")
    found = read(tmp_path, PLAIN.replace("class", "class_id").replace("cup", "1"), "A.CSV")
    assert {one.name for one in found} == {"cup"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{PLAIN}1,hand,nan,1,9,9\n", "line 6: x_min must be a number, not 'nan'"),
        (f"# first\n{PLAIN}1,hand,9,1,1,9\n", "line 7: a box needs x_min < x_max"),
        (f"{PLAIN}1,hand,5,1,5,9\n", "line 6: a box needs x_min < x_max"),
        (f"{HEAD},class\n", "line 1: the column 'class' is there twice"),
        ("Frame;Class;x1\n", "line 1: the column 'y_min' is missing"),
        (f"{PLAIN}4,cup,1,1,9,9\n", "line 6: frame 4 is beyond a, whose 4 frames count from 0"),
    ],
)
def test_a_wrong_row_has_its_line(tmp_path, text, words):
    with pytest.raises(DemoError, match=words):
        read(tmp_path, text)


@pytest.mark.parametrize("most", [1.0, 1.04])
def test_shares_of_the_picture_are_refused_also_where_one_is_beyond_it(tmp_path, most):
    boxes = read(tmp_path, f"{HEAD}\n0,cup,0.1,0.1,0.3,{most}\n1,cup,0.1,0.1,0.3,0.9\n", frames=2)
    with pytest.raises(DemoError, match=f"all edges are at most {most:.3g}, so the boxes seem to"):
        within(film(tmp_path), boxes)


def test_what_may_be_wrong_with_boxes_is_said(tmp_path):
    small = film(tmp_path, size=(20, 10))
    assert doubts(small, read(tmp_path, PLAIN)) == []
    late = "\n".join([HEAD, *ROWS[1:4]])
    (said,) = doubts(small, read(tmp_path, late))
    assert "if they were counted from 1, all boxes are one frame late" in said
    large = film(tmp_path, size=(640, 480))
    (said,) = doubts(large, read(tmp_path, PLAIN))
    assert "all boxes lie in the upper left 12 x 9 of 640 x 480 pixels" in said


def test_corners_in_place_of_sizes_are_said(tmp_path):
    boxes = read(tmp_path, f"{HEAD}\n0,cup,30,20,69,55\n1,cup,30,20,72,40\n2,cup,9,9,20,20\n")
    (said,) = doubts(film(tmp_path), boxes)
    assert said.startswith("67% of the boxes reach far beyond the right or lower edge")


def test_classes_that_differ_in_capitals_alone_are_refused(tmp_path):
    require_distinct(tmp_path, ["cup", "cups", "hand", "hand"])
    with pytest.raises(DemoError, match="the classes 'Cup' and 'cup' differ in capitals alone"):
        require_distinct(tmp_path, ["Cup", "cup"])


@pytest.mark.parametrize("name", ["a.zip", "a.csv.gz", "annotations.xml.gz", "a.mp4.ZIP"])
def test_packed_boxes_are_said(tmp_path, name):
    (tmp_path / name).write_bytes(b"PK")
    with pytest.raises(DemoError, match=rf"{name}: the boxes of a\.mp4 are packed; unpack this"):
        boxes_of(film(tmp_path))


def test_a_folder_of_pictures_beside_a_table_is_no_second_place(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "000001.jpg").write_bytes(b"x")
    assert len(read(tmp_path, PLAIN)) == FRAMES
    (tmp_path / "a" / "a_1.txt").write_text("0 0.5 0.5 0.1 0.1")
    with pytest.raises(DemoError, match=r"both a\.csv and a are beside it"):
        boxes_of(film(tmp_path))
