"""Every format gives the boxes that were written into it, and is told from what is in it."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.paths import TESTS
from support.wrong_boxes import NAMES, H, W

from gril_jax.demos.formats import boxes_of, file_of, reader
from gril_jax.demos.formats.record import Film
from gril_jax.errors import DemoError

FRAMES = 5
# (frame, class, x_min, y_min, x_max, y_max, track): a cup that moves, one that goes, a hand.
TRUE = [
    *((t, "cup", 10.0 + 8 * t, 20.0, 40.0 + 8 * t, 60.0, 1) for t in range(FRAMES)),
    *((t, "cup", 150.0, 50.0 + t, 170.0, 80.0 + t, 2) for t in range(3)),
    *((t, "hand", 90.0, 5.0, 130.0, 45.5, 3) for t in range(1, FRAMES)),
]


def film(folder):
    return Film(folder / "a.mp4", [t / 10 for t in range(FRAMES)], W, H)


def by_track(rows):
    """The rows of each track, by frame."""
    found = {}
    for row in rows:
        found.setdefault(row[6], {})[row[0]] = row
    return found


# ---- writers: (folder, rows), each the form of a tool


def csv(folder, rows):
    lines = (f"{t},{n},{a!r},{b!r},{c!r},{d!r},0.9,{k},spare" for t, n, a, b, c, d, k in rows)
    head = "frame,class,x_min,y_min,x_max,y_max,confidence,track,note"
    (folder / "a.csv").write_text("\n".join([head, *lines]))


def mot(folder, rows, of=str, name="a.txt"):
    lines = (f"{t + 1},{k},{a},{b},{c - a},{d - b},1,{of(n)},1.0" for t, n, a, b, c, d, k in rows)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text("\n".join(lines))


def mot_numbers(folder, rows):
    (folder / "names.txt").write_text("\n".join(NAMES))
    mot(folder, rows, lambda name: NAMES.index(name) + 1)


def mot_folders(folder, rows):
    mot(folder, rows, name="a/gt/gt.txt")


def cvat(folder, rows):
    tracks = []
    for track, own in by_track(rows).items():
        last = next(iter(own.values()))
        boxes = []
        for t in range(FRAMES):
            _, _, a, b, c, d, _ = last = own.get(t, last)
            where = f'xtl="{a}" ytl="{b}" xbr="{c}" ybr="{d}" z_order="0"'
            boxes.append(f'<box frame="{t}" outside="{int(t not in own)}" keyframe="1" {where}/>')
        tracks.append(f'<track id="{track}" label="{last[1]}">{"".join(boxes)}</track>\n')
    size = f"<original_size><width>{W}</width><height>{H}</height></original_size>"
    head = '<?xml version="1.0" encoding="utf-8"?>\n<annotations><version>1.1</version>\n'
    text = f"{head}<meta><task>{size}</task></meta>\n{''.join(tracks)}</annotations>"
    (folder / "a.xml").write_text(text)


def coco(folder, rows):
    images = [
        {"id": 10 + t, "file_name": f"a/{t:06d}.jpg", "width": W, "height": H, "frame_id": t}
        for t in range(FRAMES)
    ]
    notes = [
        {"id": i, "image_id": 10 + t, "category_id": NAMES.index(n) + 1, "track_id": k,
         "bbox": [a, b, c - a, d - b]}
        for i, (t, n, a, b, c, d, k) in enumerate(rows)
    ]  # fmt: skip
    names = [{"id": i + 1, "name": name} for i, name in enumerate(NAMES)]
    text = json.dumps({"images": images, "annotations": notes, "categories": names})
    (folder / "a.json").write_text(text)


def label_studio(folder, rows):
    """With a key at the frames alone between which a box does not move in a line."""
    results = []
    for track, own in by_track(rows).items():
        places = {t: np.array(row[2:6]) for t, row in own.items()}
        inner = [t for t in own if t - 1 in own and t + 1 in own
                 and np.array_equal(2 * places[t], places[t - 1] + places[t + 1])]  # fmt: skip
        sequence = [
            {"frame": t + 1, "enabled": t + 1 in own or t == FRAMES - 1, "rotation": 0,
             "x": a / W * 100, "y": b / H * 100, "width": (c - a) / W * 100,
             "height": (d - b) / H * 100, "time": t / 10}
            for t, _, a, b, c, d, _ in own.values() if t not in inner
        ]  # fmt: skip
        name = next(iter(own.values()))[1]
        value = {"framesCount": FRAMES, "sequence": sequence, "labels": [name]}
        results.append({"id": track, "type": "videorectangle", "value": value})
    data = {"video": "/data/upload/1/3f2a91bc-a.mp4"}
    other = {"data": {"video": "b.mp4"}, "annotations": []}
    text = json.dumps([other, {"data": data, "annotations": [{"result": results}]}])
    (folder / "a.json").write_text(text)


def yolo(folder, rows):
    (folder / "a").mkdir()
    for t in range(FRAMES):
        lines = (
            f"{NAMES.index(n)} {(a + c) / 2 / W} {(b + d) / 2 / H} {(c - a) / W} {(d - b) / H} {k}"
            for frame, n, a, b, c, d, k in rows
            if frame == t
        )
        (folder / "a" / f"a_{t + 1}.txt").write_text("\n".join(lines))
    (folder / "names.txt").write_text("\n".join(NAMES))


FORMATS = (csv, mot, mot_numbers, mot_folders, cvat, coco, label_studio, yolo)
EDGE = st.integers(0, 64 * 99).map(lambda n: n / 64)  # pixels, of no more digits than floats have


@st.composite
def rows_of_tracks(draw):
    """Rows of one to four tracks, in order of time, each of one class and of some frames."""
    rows = []
    for track in range(1, 1 + draw(st.integers(1, 4))):
        name = draw(st.sampled_from(NAMES))
        for t in sorted(draw(st.sets(st.integers(0, FRAMES - 1), min_size=1))):
            low, side = (draw(st.tuples(EDGE, EDGE)) for _ in range(2))
            high = [one + other + 1 / 64 for one, other in zip(low, side, strict=True)]
            rows.append((t, name, *low, *high, track))
    return sorted(rows, key=lambda row: row[0])


@pytest.mark.parametrize("write", FORMATS, ids=lambda write: write.__name__)
@settings(max_examples=25, deadline=None)
@given(rows=rows_of_tracks())
def test_boxes_come_back_as_they_were_written(write, rows):
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), rows)
        found = boxes_of(film(Path(folder)))
        assert all(folder in one.where for one in found)
    mine = sorted((one.frame, int(one.track), one.name, *one.edges) for one in found)
    true = sorted((t, k, n, a, b, c, d) for t, n, a, b, c, d, k in rows)
    assert [row[:3] for row in mine] == [row[:3] for row in true]
    np.testing.assert_allclose([r[3:] for r in mine], [r[3:] for r in true], atol=1e-9)


def test_numbered_classes_of_motchallenge_may_begin_with_0(tmp_path):
    (tmp_path / "names.txt").write_text("\n".join(NAMES))
    mot(tmp_path, TRUE, NAMES.index)
    assert [one.name for one in boxes_of(film(tmp_path))] == [
        row[1] for row in sorted(TRUE, key=lambda row: row[0])
    ]


def test_a_frame_0_and_a_class_0_count_for_all_texts_of_a_folder(tmp_path):
    """A video that does not show the first class, and nothing in its first frame."""
    (tmp_path / "names.txt").write_text("\n".join(NAMES))
    (tmp_path / "a.txt").write_text("1,1,0,0,9,9,1,1,1\n2,1,0,0,9,9,1,1,1\n")
    assert {(b.frame, b.name) for b in boxes_of(film(tmp_path))} == {(0, NAMES[0]), (1, NAMES[0])}
    (tmp_path / "b.txt").write_text("0,1,0,0,9,9,1,0,1\n")
    assert {(b.frame, b.name) for b in boxes_of(film(tmp_path))} == {(1, NAMES[1]), (2, NAMES[1])}


WRITTEN = sorted((TESTS / "data" / "boxes").iterdir())


@pytest.mark.parametrize("folder", WRITTEN, ids=lambda folder: folder.name)
def test_files_that_other_tools_wrote_give_the_boxes_of_our_csv(folder):
    """Written by supervision 0.31.2 and datumaro 1.13.12 from `TRUE`."""
    found = boxes_of(film(folder))
    rows = sorted((b.frame, b.name, *b.edges) for b in found)
    true = sorted(row[:6] for row in TRUE)
    assert [row[:2] for row in rows] == [row[:2] for row in true]
    np.testing.assert_allclose([r[2:] for r in rows], [r[2:] for r in true], atol=0.5)
    tracks = {row.track for row in found}
    identities = not folder.name.endswith("yolo") and folder.name != "supervision_coco"
    assert tracks == ({"1", "2", "3"} if identities else {None})


def test_other_tools_read_the_texts_of_these_tests_alike(tmp_path):
    """Formats that nothing but their own server writes are checked the other way round."""
    datumaro = pytest.importorskip("datumaro", reason="datumaro is not installed")
    motmetrics = pytest.importorskip("motmetrics", reason="motmetrics is not installed")
    cvat(tmp_path, TRUE)
    items = datumaro.Dataset.import_from(str(tmp_path / "a.xml"), "cvat")
    seen = sorted((one.attributes["frame"], *box.get_bbox()) for one in items
                  for box in one.annotations if not box.attributes.get("outside"))  # fmt: skip
    true = sorted((t, a, b, c - a, d - b) for t, _, a, b, c, d, _ in TRUE)
    np.testing.assert_allclose(seen, true, atol=0.5)
    mot_numbers(tmp_path, TRUE)
    table = motmetrics.io.loadtxt(tmp_path / "a.txt", fmt="mot16", min_confidence=-1)
    seen = sorted((frame - 1, row.X + 1, row.Y + 1, row.Width, row.Height)
                  for (frame, _), row in table.iterrows())  # fmt: skip
    np.testing.assert_allclose(seen, true, atol=0.5)


def test_a_box_has_its_file_and_line(tmp_path):
    csv(tmp_path, TRUE)
    assert boxes_of(film(tmp_path))[0].where == f"{tmp_path / 'a.csv'}, line 2"


def test_boxes_must_be_in_one_place(tmp_path):
    with pytest.raises(
        DemoError, match=r"no boxes are beside the video: they must be one of a\.csv"
    ):
        file_of(tmp_path / "a.mp4")
    (tmp_path / "a.csv").write_text("")
    (tmp_path / "a.txt").write_text("")
    with pytest.raises(DemoError, match=r"both a\.csv and a\.txt"):
        file_of(tmp_path / "a.mp4")
    with pytest.raises(DemoError, match="no regular file"):
        reader(tmp_path / "gone.csv")
