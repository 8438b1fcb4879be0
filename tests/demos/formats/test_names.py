"""A file of several videos gives each its own boxes; names are the same in all their forms."""

import json
from pathlib import Path

import pytest

from gril_jax.demos.formats import boxes_of, file_of
from gril_jax.demos.formats.fit import require_told_apart
from gril_jax.demos.formats.names import best, class_name
from gril_jax.demos.formats.record import Film
from gril_jax.errors import DemoError

FRAMES, W, H = 5, 64, 48
ONE, TWO = "K\u00fcche", "Ku\u0308che"  # an umlaut in one letter, and in two


def film(folder, name="a.mp4"):
    return Film(folder / name, [t / 10 for t in range(FRAMES)], W, H)


def left(folder, name="a.mp4"):
    """Where the boxes of a video begin: each video has another place in the file."""
    return {one.edges[0] for one in boxes_of(film(folder, name))}


@pytest.mark.parametrize(
    ("name", "given", "found"),
    [
        ("a.mp4", ["kitchen-a.mp4", "s3://b/a.mp4?x=1"], [1]),
        ("a.mp4", ["a.mov", "a.mp4"], [1]),
        ("a.mp4", ["0a1b2c3d-a.mp4", "C:\\videos\\a.mov"], [1]),
        ("a.mp4", ["kitchen-a.mp4", "1-a.mp4"], []),
        ("my video.mp4", ["0a1b2c3d-my_video.mp4"], [0]),
        ("v1.5.mp4", ["v1.5", "v1.mp4"], [0]),
        ("a.mp4", ["x/a.mp4", "y/a.mp4"], [0, 1]),
        (f"{ONE}.mp4", [f"{TWO}.mp4"], [0]),
    ],
)
def test_the_most_exact_name_counts(name, given, found):
    assert best(Path(name), [[one] for one in given]) == found


@pytest.mark.parametrize(("video", "boxes"), [(ONE, TWO), (TWO, ONE)])
def test_names_of_files_and_classes_are_compared_in_one_unicode_form(tmp_path, video, boxes):
    rows = f"0,{ONE},1,1,9,9\n0,{TWO},21,1,29,9\n"
    (tmp_path / f"{boxes}.csv").write_text(f"frame,class,x_min,y_min,x_max,y_max\n{rows}")
    own = film(tmp_path, f"{video}.mp4")
    assert [one.name for one in boxes_of(own)] == [ONE, ONE]
    assert own.name == ONE


def test_a_class_may_have_joiners_inside_but_no_other_control_characters():
    persian = "\u0646\u06cc\u0645\u200c\u0641\u0646\u062c\u0627\u0646"
    assert class_name(persian, "x") == persian
    assert class_name(f"\u200d{persian}\u200c", "x") == persian
    for wrong in ("cu\u200ep", "cu\u202ep", "\u200c", "cu\x00p", "cu\ufeffp"):
        with pytest.raises(DemoError, match="a class must be a name"):
            class_name(wrong, "x")


def cvat(folder, tasks, tracks, frames=(0, 0, 0), more=("", "", "")):
    """`tasks` are (id, name, source); `tracks` the further field of one at x = 10, 20, ..., which
    has a box in one of `frames`; `more` is said of each task."""
    size = f"<original_size><width>{W}</width><height>{H}</height></original_size>"
    meta = "".join(
        f"<task><id>{i}</id><name>{name}</name><source>{source}</source>{size}{said}</task>"
        for (i, name, source), said in zip(tasks, more, strict=False)
    )
    boxes = "".join(
        f'<track id="{n}" label="cup" {task}>'
        f'<box frame="{frames[n]}" outside="0" '
        f'xtl="{10 * n + 10}" ytl="1" xbr="{10 * n + 15}" ybr="9"/>'
        "</track>"
        for n, task in enumerate(tracks)
    )
    text = f"<annotations><meta><project><tasks>{meta}</tasks></project></meta>{boxes}"
    (folder / "annotations.xml").write_text(f"{text}</annotations>")


def test_a_project_of_cvat_gives_each_video_its_own_tracks(tmp_path):
    cvat(
        tmp_path,
        [(7, "first", "a.mp4"), (8, "b", "upload.mp4")],
        ["task_id='7'", "task_id='8'", "task_id='7'"],
    )
    assert left(tmp_path) == {10.0, 30.0}
    assert left(tmp_path, "b.mp4") == {20.0}
    cvat(tmp_path, [(7, "x", "a.mp4"), (8, "b", "y.mp4")], ["source='a.mp4'", "task='b'"])
    assert (left(tmp_path), left(tmp_path, "b.mp4")) == ({10.0}, {20.0})


SIZE = "<size>5</size>"
IN_STEPS = "<size>2</size><start_frame>1</start_frame><frame_filter>step=2</frame_filter>"


@pytest.mark.parametrize(
    ("frames", "more", "found"),
    [
        ((4, 5 + 3, 10 + 2), (SIZE, SIZE, SIZE), (4, 3, 2)),  # as CVAT writes them
        ((4, 5 + 3, 2), (SIZE, SIZE + "<subset>x</subset>", SIZE), (4, None, 2)),
        ((4, 3, 5 + 2), (SIZE, *[SIZE + "<subset>x</subset>"] * 2), (4, 3, 2)),
        ((3, 5 + 3, 10 + 2), (IN_STEPS, SIZE, SIZE), (3, 3, 2)),  # 1 + 2 x 2 frames of the first
        ((4, 3, 2), (SIZE, SIZE, SIZE), (4, 3, 2)),  # each task by itself
    ],
)
def test_the_frames_of_a_project_s_tasks_follow_each_other(tmp_path, frames, more, found):
    tasks = [(7, "a", "a.mp4"), (8, "b", "b.mp4"), (9, "c", "c.mp4")]
    cvat(tmp_path, tasks, [f"task_id='{n}'" for n, *_ in tasks], frames, more)
    for name, frame in zip("abc", found, strict=True):
        if frame is None:
            with pytest.raises(DemoError, match="frame 8 is beyond"):
                boxes_of(film(tmp_path, f"{name}.mp4"))
        else:
            assert {one.frame for one in boxes_of(film(tmp_path, f"{name}.mp4"))} == {frame}


@pytest.mark.parametrize(
    ("tasks", "tracks", "words"),
    [
        ([(7, "x", "x.mp4"), (8, "y", "y.mp4")], [], r"no task is of a\.mp4; .* x\.mp4, y"),
        ([(7, "a", "a.mp4"), (8, "b", "b.mp4")], [""], "task_id None of the track is none of"),
        ([(7, "x", "a.mp4"), (8, "y", "a.mp4")], [], r"2 tasks are of a\.mp4"),
    ],
)
def test_tasks_that_are_not_told_apart_are_refused(tmp_path, tasks, tracks, words):
    cvat(tmp_path, tasks, tracks)
    with pytest.raises(DemoError, match=words):
        boxes_of(film(tmp_path))


def studio(folder, tasks):
    """`tasks` are names of videos, with a box at x = 10, 20, ... per cent, or None."""
    tree = []
    for n, (video, done) in enumerate(tasks):
        key = {"frame": 1, "x": 10 * n + 10, "y": 1, "width": 9, "height": 9}
        value = {"labels": ["cup"], "sequence": [key]}
        result = {"id": "r", "type": "videorectangle", "value": value}
        made = [{"result": [result]}] if done else []
        tree.append({"data": {"video": video}, "annotations": made})
    (folder / "annotations.json").write_text(json.dumps(tree))


def test_tasks_of_label_studio_go_by_the_most_exact_name(tmp_path):
    studio(tmp_path, [("kitchen-a.mp4", 1), ("a.mp4", 0), ("a.mp4", 1)])
    assert [*left(tmp_path)] == [pytest.approx(0.3 * W)]
    with pytest.raises(DemoError, match=r"no task is of b\.mp4; their videos are kitchen-a, a"):
        boxes_of(film(tmp_path, "b.mp4"))
    studio(tmp_path, [("x/a.mp4", 1), ("y/a.mp4", 1)])
    with pytest.raises(DemoError, match=r"tasks 0 and 1 are both of a\.mp4"):
        boxes_of(film(tmp_path))


@pytest.mark.parametrize(
    "names", ["{}/{}.jpg", "img/{}/f_{}.jpg", "{}_{}.png", "{}_mp4-{}_jpg.rf.0a1b2.jpg"]
)
def test_coco_of_several_videos_goes_by_folders_or_names(tmp_path, names):
    images = [
        {"id": 10 * v + t, "file_name": names.format(name, t)}
        for v, name in enumerate("ab")
        for t in range(FRAMES)
    ]
    notes = [{"image_id": one["id"], "category_id": 1, "bbox": [one["id"] // 10 + 1, 1, 5, 5]}
             for one in images]  # fmt: skip
    tree = {"images": images, "annotations": notes, "categories": [{"id": 1, "name": "cup"}]}
    (tmp_path / "annotations.json").write_text(json.dumps(tree))
    assert (left(tmp_path), left(tmp_path, "b.mp4")) == ({1.0}, {2.0})
    with pytest.raises(DemoError, match=r"the images are of several videos \(.*none is called 'c'"):
        boxes_of(film(tmp_path, "c.mp4"))


def test_one_box_of_two_videos_is_refused(tmp_path):
    studio(tmp_path, [("upload.mp4", 1)])
    films = [film(tmp_path, name) for name in ("a.mp4", "b.mp4")]
    assert file_of(films[0].path).name == "annotations.json"
    boxes = [*map(boxes_of, films)]
    require_told_apart(films[:1], boxes[:1])
    with pytest.raises(DemoError, match="this box is taken for one of a and of b"):
        require_told_apart(films, boxes)


@pytest.mark.parametrize("name", ["A.CSV", "a.Csv"])
def test_capitals_of_a_file_s_name_do_not_matter(tmp_path, name):
    (tmp_path / name).write_text("frame,class,x_min,y_min,x_max,y_max\n0,cup,1,1,9,9\n")
    assert left(tmp_path) == {1.0}


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("cup\n\nhand\n", "line 2: the line is empty, so the numbers of the classes after it"),
        ("0: cup\n1: hand\n", "line 1: '0: cup' is a number and a name, but a line must be the"),
        ("1 cup\n2 hand\n", "line 1: '1 cup' is a number and a name"),
    ],
)
def test_names_whose_numbers_are_doubtful_are_refused(tmp_path, names, words):
    (tmp_path / "a.txt").write_text("1,1,1,1,9,9,1,1\n")
    (tmp_path / "names.txt").write_text("cup\n7 up\n\n")
    assert [one.name for one in boxes_of(film(tmp_path))] == ["cup"]
    (tmp_path / "names.txt").write_text(names)
    with pytest.raises(DemoError, match=words):
        boxes_of(film(tmp_path))
