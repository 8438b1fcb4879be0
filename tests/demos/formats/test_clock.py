"""A number means one frame: tools count from 0 or 1, by steps, in digits or with decimals."""

import json

import pytest

from gril_jax.demos.formats import boxes_of
from gril_jax.demos.formats.record import Film
from gril_jax.errors import DemoError

FRAMES, W, H = 20, 64, 48


def film(folder, frames=FRAMES, name="a.mp4", fps=10):
    return Film(folder / name, [t / fps for t in range(frames)], W, H)


def frames_of(folder, **about):
    return [one.frame for one in boxes_of(film(folder, **about))]


def coco(folder, images, videos=()):
    """An image's box is as far to the right as its place in `images`."""
    images = [{"id": n + 1, "width": W, "height": H} | one for n, one in enumerate(images)]
    notes = [{"id": n, "image_id": n + 1, "category_id": 1, "bbox": [n, 1, 5, 5]}
             for n in range(len(images))]  # fmt: skip
    tree = {"images": images, "annotations": notes, "categories": [{"id": 1, "name": "cup"}]}
    (folder / "a.json").write_text(json.dumps(tree | {"videos": [*videos]}))


def test_pictures_come_in_order_of_their_numbers(tmp_path):
    coco(tmp_path, [{"file_name": f"{t}.jpg"} for t in range(1, FRAMES + 1)])
    assert [one.edges[0] for one in boxes_of(film(tmp_path))] == [*range(FRAMES)]


@pytest.mark.parametrize(
    ("numbers", "frames"),
    [
        (range(0, 20, 5), [0, 5, 10, 15]),
        (range(5, 21, 5), [4, 9, 14, 19]),
        (range(1, 20, 5), [0, 5, 10, 15]),
    ],
)
def test_pictures_of_some_frames_have_their_numbers(tmp_path, numbers, frames):
    coco(tmp_path, [{"file_name": f"a/frame_{t}.jpg"} for t in numbers])
    assert frames_of(tmp_path) == frames


@pytest.mark.parametrize(
    ("numbers", "frames"),
    [(range(1, 21), range(20)), (range(20), range(20)), (range(4, 21, 4), range(3, 20, 4)),
     (range(4, 19, 2), range(4, 19, 2))],
)  # fmt: skip
def test_frame_id_counts_from_1_if_one_is_the_number_of_frames(tmp_path, numbers, frames):
    coco(tmp_path, [{"frame_id": t} for t in numbers])
    assert frames_of(tmp_path) == [*frames]


@pytest.mark.parametrize(
    ("images", "words"),
    [
        ([{"frame_id": t} for t in range(1, 20)], "frame_id goes from 1 to 19, but a.mp4 has 20"),
        ([{"frame_id": t} for t in range(0, 25)], "frame 20 is beyond a"),
        ([{"frame_id": 0}, {"file_name": "7.jpg"}], "image 1: it has no frame_id, but other"),
        ([{"frame_id": 0}, {"frame_id": 0}], "an image of frame 0 is there before"),
        ([{"file_name": f"x{'y' * t}.jpg"} for t in range(5)], "5 images without frame_id"),
        ([{"file_name": f"{t}.jpg"} for t in range(1, 6)], "the first 25% of the 20 frames"),
    ],
)
def test_frames_that_cannot_be_known_are_refused(tmp_path, images, words):
    coco(tmp_path, images)
    with pytest.raises(DemoError, match=words):
        boxes_of(film(tmp_path))


@pytest.mark.parametrize("form", ["%d", "%.1f", "%.2f", "%.18e", "%.3E"])
def test_whole_numbers_may_have_decimals(tmp_path, form):
    rows = [(t + 1, 7, 2, 3, 10, 10, 0.9, 1) for t in range(FRAMES)]
    (tmp_path / "names.txt").write_text("cup\n")
    (tmp_path / "a.txt").write_text(
        "\n".join(",".join(form % cell for cell in row[:6]) + ",0.9," + form % 1 for row in rows)
    )
    found = boxes_of(film(tmp_path))
    assert [(one.frame, one.name) for one in found] == [(t, "cup") for t in range(FRAMES)]
    assert len({one.track for one in found}) == 1
    (tmp_path / "a.txt").unlink()
    lines = "".join(f"{form % t},cup,1,1,9,9\n" for t in range(FRAMES))
    (tmp_path / "a.csv").write_text(f"frame,class,x_min,y_min,x_max,y_max\n{lines}")
    assert frames_of(tmp_path) == [*range(FRAMES)]


@pytest.mark.parametrize("text", ["1.5", "1e400", "1e-1", "-1", "", "0x1", "1_0", "9" * 60])
def test_what_is_no_whole_number_is_no_frame(tmp_path, text):
    (tmp_path / "a.csv").write_text(f"frame,class,x_min,y_min,x_max,y_max\n{text},cup,1,1,9,9\n")
    with pytest.raises(DemoError, match="frame must be a whole number from 0"):
        boxes_of(film(tmp_path))


def yolo(folder, numbers, empty=()):
    (folder / "a").mkdir()
    (folder / "names.txt").write_text("cup\n")
    for number in numbers:
        text = "" if number in empty else "0 0.5 0.5 0.1 0.1\n"
        (folder / "a" / f"a_{number}.txt").write_text(text)


def csv(folder, numbers):
    rows = "".join(f"{t - 1},cup,1,1,9,9\n" for t in numbers)
    (folder / "a.csv").write_text(f"frame,class,x_min,y_min,x_max,y_max\n{rows}")


def mot(folder, numbers):
    (folder / "a.txt").write_text("".join(f"{t},1,1,1,9,9,1,cup\n" for t in numbers))


@pytest.mark.parametrize("write", [yolo, csv, mot], ids=lambda write: write.__name__)
def test_frames_numbered_without_their_step_are_refused(tmp_path, write):
    write(tmp_path, range(1, 19))
    words = r"lie in frames 0 to 17, the first 20% of the 90 frames of a\.mp4, .* one frame in 5:"
    with pytest.raises(DemoError, match=words):
        frames_of(tmp_path, frames=90)
    assert frames_of(tmp_path, frames=20) == [*range(18)]


def test_boxes_may_end_early_if_the_last_frame_was_looked_at(tmp_path):
    yolo(tmp_path, [*range(1, 19), 90], empty=[90])
    assert frames_of(tmp_path, frames=90) == [*range(18)]


def test_numbers_with_their_step_are_frames(tmp_path):
    yolo(tmp_path, range(5, 91, 5))
    assert frames_of(tmp_path, frames=90) == [*range(4, 90, 5)]


def test_one_text_for_a_whole_video_is_refused(tmp_path):
    yolo(tmp_path, [0])
    with pytest.raises(DemoError, match=r"a_0\.txt: this is the only text of a\.mp4, which has 20"):
        boxes_of(film(tmp_path))
    (tmp_path / "b.txt").write_text("0 0.5 0.5 0.1 0.1 0.9\n" * FRAMES)
    with pytest.raises(DemoError, match=r"b\.txt, line 1: this is YOLO text, .* a folder b of"):
        boxes_of(film(tmp_path, name="b.mp4"))


def test_all_boxes_of_one_frame_are_refused(tmp_path):
    rows = "".join(f"0,cup,{t},1,{t + 9},9\n" for t in range(FRAMES))
    (tmp_path / "a.csv").write_text(f"frame,class,x_min,y_min,x_max,y_max\n{rows}")
    with pytest.raises(
        DemoError, match=r"all boxes are of frame 0, 20 of 'cup', but a\.mp4 has 20"
    ):
        boxes_of(film(tmp_path))


def test_a_csv_that_was_appended_to_itself_is_read(tmp_path):
    csv(tmp_path, range(1, 21))
    text = (tmp_path / "a.csv").read_text()
    (tmp_path / "a.csv").write_text(text + text)
    assert frames_of(tmp_path) == sorted(2 * [*range(20)])


def studio(folder, **value):
    keys = [{"frame": frame, "enabled": True, "x": x, "y": 10, "width": 10, "height": 10}
            for frame, x in ((1, 0), (25, 48))]  # fmt: skip
    result = {"id": "r", "type": "videorectangle",
              "value": {"labels": ["cup"], "sequence": keys} | value}  # fmt: skip
    tree = [{"data": {"video": "a.mp4"}, "annotations": [{"result": [result]}]}]
    (folder / "a.json").write_text(json.dumps(tree))


def test_label_studio_may_count_frames_at_another_rate(tmp_path):
    studio(tmp_path, framesCount=25, duration=1.0)
    found = boxes_of(film(tmp_path, frames=50, fps=50))
    assert [one.frame for one in found] == [*range(50)]
    assert [one.edges[0] / W * 100 for one in found[:49]] == pytest.approx([*range(49)], abs=1e-4)


@pytest.mark.parametrize("value", [{"framesCount": 25}, {"framesCount": 100, "duration": 4.0}])
def test_label_studio_s_frames_of_another_video_are_refused(tmp_path, value):
    studio(tmp_path, **value)
    with pytest.raises(DemoError, match=r"framesCount is \d+.*, but a\.mp4 has 50 frames in 1 s"):
        boxes_of(film(tmp_path, frames=50, fps=50))


def cvat(folder, meta, frames):
    boxes = "".join(f'<box frame="{t}" xtl="1" ytl="1" xbr="9" ybr="9"/>' for t in frames)
    track = f'<track id="0" label="cup">{boxes}</track>'
    text = f"<annotations><meta><task><id>1</id>{meta}</task></meta>{track}</annotations>"
    (folder / "a.xml").write_text(text)


STEP = "<frame_filter>step=5</frame_filter>"


@pytest.mark.parametrize(
    ("meta", "frames", "words"),
    [
        ("<stop_frame>39</stop_frame>", [0], "the task's last frame is 39, but a.mp4 has 20"),
        ("<size>40</size>", [0], "the task's last frame is 39, but a.mp4 has 20 frames"),
        ("<size>10</size>", range(10), "the first 50% of the 20 frames"),
        (f"<size>4</size>{STEP}", range(4), "a box of frame 1, but the task has one frame in 5"),
    ],
)
def test_a_task_of_cvat_of_another_rate_is_refused(tmp_path, meta, frames, words):
    cvat(tmp_path, meta, frames)
    with pytest.raises(DemoError, match=words):
        boxes_of(film(tmp_path))


@pytest.mark.parametrize(
    ("meta", "frames"),
    [(f"<size>4</size><stop_frame>19</stop_frame>{STEP}", [0, 5, 10, 15]),
     ("<size>20</size>", range(10)), ("<size>21</size>", range(20))],
)  # fmt: skip
def test_the_boxes_of_a_task_of_cvat_are_of_the_video_s_frames(tmp_path, meta, frames):
    cvat(tmp_path, meta, frames)
    assert frames_of(tmp_path) == [*frames]


def test_a_table_and_motchallenge_count_from_0_or_1(tmp_path):
    csv(tmp_path, range(2, FRAMES + 2))  # 1 to 20
    assert frames_of(tmp_path) == [*range(FRAMES)]
    (tmp_path / "a.csv").unlink()
    mot(tmp_path, range(FRAMES))
    assert frames_of(tmp_path) == [*range(FRAMES)]
    mot(tmp_path, range(1, FRAMES + 2))
    with pytest.raises(DemoError, match="frame 21 is beyond a, whose 20 frames count from 1 to 20"):
        frames_of(tmp_path)


@pytest.mark.parametrize("said", ["seqLength=40", "imWidth=128", "seqLength=20\nimHeight=24"])
def test_a_sequence_of_motchallenge_must_be_of_this_video(tmp_path, said):
    (tmp_path / "a" / "gt").mkdir(parents=True)
    mot(tmp_path / "a" / "gt", range(1, FRAMES + 1))
    (tmp_path / "a" / "gt" / "a.txt").rename(tmp_path / "a" / "gt" / "gt.txt")
    about = tmp_path / "a" / "seqinfo.ini"
    about.write_text(f"[Sequence]\nname=a\nseqLength=20\nimWidth={W}\nimHeight={H}\n")
    assert frames_of(tmp_path) == [*range(FRAMES)]
    about.write_text(f"[Sequence]\nname=a\n{said}\n")
    with pytest.raises(DemoError, match=r"seqinfo\.ini: .* but a\.mp4 has 20 frames of 64 x 48"):
        frames_of(tmp_path)


def test_a_task_of_cvat_has_no_boxes_before_its_first_frame(tmp_path):
    cvat(tmp_path, "<start_frame>10</start_frame><stop_frame>19</stop_frame>", range(10))
    with pytest.raises(DemoError, match="a box of frame 0, but the task begins at frame 10"):
        boxes_of(film(tmp_path))


@pytest.mark.parametrize("names", ["{}_cam3.jpg", "frame{}_0.25s.jpg"])
def test_a_picture_s_number_that_is_not_the_last_in_its_name_is_not_guessed(tmp_path, names):
    coco(tmp_path, [{"file_name": names.format(t)} for t in range(0, FRAMES, 5)])
    with pytest.raises(DemoError, match=r"4 images without frame_id are of a\.mp4"):
        boxes_of(film(tmp_path))


def test_a_picture_without_a_size_may_have_a_number_of_another_name(tmp_path):
    coco(tmp_path, [{"frame_number": t, "width": 0, "height": None} for t in range(0, FRAMES, 5)])
    assert frames_of(tmp_path) == [0, 5, 10, 15]


@pytest.mark.parametrize("ending", ["{}.TXT", "mp4-{}_jpg.rf.0a1b2c.txt", "{}_png.rf.7777.txt"])
def test_texts_of_yolo_are_numbered_by_roboflow_and_in_capitals_too(tmp_path, ending):
    (tmp_path / "a").mkdir()
    (tmp_path / "names.txt").write_text("cup\n")
    for number in range(FRAMES):
        (tmp_path / "a" / ("a_" + ending.format(number))).write_text("0 0.5 0.5 0.1 0.1")
    assert frames_of(tmp_path) == [*range(FRAMES)]
