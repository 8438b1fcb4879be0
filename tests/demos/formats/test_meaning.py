"""What a tool means: skipped work, turned boxes, polygons, no identity, boxes written twice."""

import json

import pytest

from gril_jax.demos.formats import boxes_of
from gril_jax.demos.formats.fit import once
from gril_jax.demos.formats.record import Film
from gril_jax.errors import DemoError

FRAMES, W, H = 5, 64, 48
HEAD = "frame,class,x_min,y_min,x_max,y_max,confidence,track"


def film(folder):
    return Film(folder / "a.mp4", [t / 10 for t in range(FRAMES)], W, H)


def annotation(*places, kind="videorectangle", **about):
    results = [
        {"id": f"r{x}", "type": kind, "value": {"labels": ["cup"], "sequence": [
            {"frame": 1, "x": x, "y": 10, "width": 10, "height": 10}]}}
        for x in places
    ]  # fmt: skip
    return {"result": results} | about


def studio(folder, *annotations):
    task = {"data": {"video": "a.mp4"}, "annotations": [*annotations], "drafts": [annotation(50)]}
    (folder / "a.json").write_text(json.dumps([task]))


@pytest.mark.parametrize(
    "annotations",
    [
        (annotation(20, was_cancelled=True), annotation(10, was_cancelled=False)),
        ({"was_cancelled": True}, annotation(10, was_cancelled=None)),
        (annotation(20), annotation(10, ground_truth=True)),
        (annotation(), annotation(10)),
        (annotation(10), annotation(10)),
    ],
)
def test_the_finished_annotation_counts(tmp_path, annotations):
    studio(tmp_path, *annotations)
    assert [one.edges[0] for one in boxes_of(film(tmp_path))] == [pytest.approx(0.1 * W)] * FRAMES


@pytest.mark.parametrize(
    ("annotations", "words"),
    [
        ((), r"nobody has annotated it yet \(drafts do not count"),
        ((annotation(1, was_cancelled=True),), "nobody has annotated it yet; all annotations are"),
        ((annotation(1), annotation(2)), "2 finished annotations differ; mark one of them"),
        ((annotation(1, kind="polygonlabels"),), "a polygonlabels is in a box's place"),
    ],
)
def test_annotations_that_do_not_count_are_refused(tmp_path, annotations, words):
    studio(tmp_path, *annotations)
    with pytest.raises(DemoError, match=words):
        boxes_of(film(tmp_path))


def cvat(folder, shape):
    text = f'<annotations><track id="0" label="cup">{shape}</track></annotations>'
    (folder / "a.xml").write_text(text)


def test_a_turned_box_of_cvat_counts_by_the_upright_box_around_it(tmp_path):
    cvat(tmp_path, '<box frame="0" xtl="10" ytl="20" xbr="30" ybr="24" rotation="90"/>')
    assert boxes_of(film(tmp_path))[0].edges == pytest.approx((18, 12, 22, 32))


@pytest.mark.parametrize("shape", ["polygon", "mask", "ellipse", "skeleton"])
def test_another_shape_in_a_box_s_place_is_refused(tmp_path, shape):
    cvat(tmp_path, f'<{shape} frame="0" outside="0" points="1,1;9,9;1,9"/>')
    with pytest.raises(DemoError, match=f"line 1: a <{shape}> of 'cup' is in a box's place"):
        boxes_of(film(tmp_path))
    (tmp_path / "a.xml").unlink()
    tree = {"images": [{"id": 1}], "categories": [{"id": 1, "name": "cup"}], "annotations": [
        {"image_id": 1, "category_id": 1, "segmentation": [[1, 1, 9, 9, 1, 9]]}]}  # fmt: skip
    (tmp_path / "a.json").write_text(json.dumps(tree))
    with pytest.raises(DemoError, match="annotation 0: a mask or polygon is in a box's place"):
        boxes_of(film(tmp_path))


@pytest.mark.parametrize("points", [3, 4, 12])
def test_a_polygon_of_yolo_is_refused(tmp_path, points):
    (tmp_path / "a").mkdir()
    (tmp_path / "names.txt").write_text("cup")
    (tmp_path / "a" / "a_1.txt").write_text("0" + " 0.25 0.5" * points)
    with pytest.raises(DemoError, match=f"{2 * points + 1} columns are a polygon or a turned box"):
        boxes_of(film(tmp_path))


@pytest.mark.parametrize("none", ["-1", "-1.0", "", "nan", "None"])
def test_no_identity_may_be_that_of_several(tmp_path, none):
    (tmp_path / "a.csv").write_text(f"{HEAD}\n0,cup,1,1,9,9,1,{none}\n0,cup,21,1,29,9,1,{none}\n")
    assert [one.track for one in boxes_of(film(tmp_path))] == [None, None]


@pytest.mark.parametrize("track", ["-1", "7"])
def test_a_box_that_is_written_twice_is_one(tmp_path, track):
    rows = "".join(f"{t},cup,{t + 1},1,{t + 9},9,0.9,{track}\n" for t in range(FRAMES))
    near = "0,cup,1.01,1,9.01,9,0.8,-1\n" if track == "-1" else ""
    (tmp_path / "a.csv").write_text(f"{HEAD}\n{rows}{rows}{near}")
    kept, twice = once(boxes_of(film(tmp_path)))
    assert [one.frame for one in kept] == [*range(FRAMES)]
    assert twice == FRAMES + bool(near)


def test_two_objects_near_each_other_are_two(tmp_path):
    (tmp_path / "a.csv").write_text(f"{HEAD}\n0,cup,1,1,9,9,1,\n0,cup,2,1,10,9,1,\n")
    assert once(boxes_of(film(tmp_path)))[1] == 0


def key(frame, x, outside=0):
    edges = f'xtl="{x}" ytl="1" xbr="{x + 9}" ybr="9"'
    return f'<box frame="{frame}" keyframe="1" outside="{outside}" {edges}/>'


def test_boxes_of_cvat_lie_on_lines_between_key_frames(tmp_path):
    other = f'</track><track id="1" label="hand">{key(0, 30)}'
    cvat(tmp_path, f"{key(0, 0)}{key(1, 1)}{key(4, 7)}{other}")
    found = [(one.frame, one.edges[0]) for one in boxes_of(film(tmp_path)) if one.name == "cup"]
    assert found == [(0, 0), (1, 1), (2, 3), (3, 5), (4, 7)]
    hands = [one.edges[0] for one in boxes_of(film(tmp_path)) if one.name == "hand"]
    assert hands == [30] * FRAMES
    cvat(tmp_path, f"{key(0, 0)}{key(1, 1, 1)}{key(3, 7)}{key(4, 8)}")
    assert [one.frame for one in boxes_of(film(tmp_path))] == [0, 3, 4]


def test_what_a_person_drew_is_told_from_what_a_detector_did(tmp_path):
    for source, drawn in (("manual", True), ("auto", False)):
        shape = f'</track><track id="2" label="cup" source="{source}">{key(0, 1)}'
        cvat(tmp_path, shape)
        assert [one.drawn for one in boxes_of(film(tmp_path))] == [drawn]


def test_xml_is_unicode_whatever_it_says(tmp_path):
    text = f'<annotations><track id="0" label="Tüte">{key(0, 1)}</track></annotations>'
    head = '<?xml version="1.0" encoding="iso-8859-1"?>'
    (tmp_path / "a.xml").write_text(head + text, encoding="utf-8")
    assert boxes_of(film(tmp_path))[0].name == "Tüte"


def test_a_number_of_two_classes_is_refused(tmp_path):
    names = [{"id": 1, "name": "cup"}, {"id": 1, "name": "hand"}]
    notes = [{"image_id": 1, "category_id": 1, "bbox": [1, 1, 8, 8]}]
    tree = {"images": [{"id": 1}], "categories": names, "annotations": notes}
    (tmp_path / "a.json").write_text(json.dumps(tree))
    with pytest.raises(DemoError, match="category 1: id 1 is 'cup' before, and 'hand'"):
        boxes_of(film(tmp_path))


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ([{"video": "a.mp4", "box": []}], "task 0: has no data, so it is not of Label Studio's"),
        ([{"image_id": 1, "category_id": 1, "bbox": [1, 1, 8, 8]}], "task 0: has no data"),
        ({"shapes": [], "imagePath": "a.jpg"}, "this JSON is not of COCO or Label Studio"),
    ],
)
def test_json_of_another_tool_is_said(tmp_path, tree, words):
    (tmp_path / "a.json").write_text(json.dumps(tree))
    with pytest.raises(DemoError, match=words):
        boxes_of(film(tmp_path))


def test_a_column_of_ones_of_several_cups_is_a_confidence(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "names.txt").write_text("cup")
    for t in range(FRAMES):
        (tmp_path / "a" / f"a_{t}.txt").write_text(
            "0 .2 .5 .1 .1 1\n0 .8 .5 .1 .1 1\n".replace(" .", " 0.")
        )
    found = boxes_of(film(tmp_path))
    assert [(one.track, one.confidence) for one in found] == [(None, 1.0)] * 2 * FRAMES
