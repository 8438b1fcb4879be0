"""Every format gives the boxes that our CSV gives, and is told from what is in it."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.paths import TESTS
from support.wrong_boxes import NAMES, WRONG, H, W

from gril_jax.demos.formats.recognise import boxes_of, file_of, reader
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


def csv_text():
    rows = (f"{t},{n},{a},{b},{c},{d},0.9,{k},spare" for t, n, a, b, c, d, k in TRUE)
    return "\n".join(["frame,class,x_min,y_min,x_max,y_max,confidence,track,note", *rows])


def mot_text(of=lambda name: NAMES.index(name) + 1):
    return "\n".join(
        f"{t + 1},{k},{a},{b},{c - a},{d - b},1,{of(n)},1.0" for t, n, a, b, c, d, k in TRUE
    )


def cvat_text():
    tracks = []
    for track in (1, 2, 3):
        own = {row[0]: row for row in TRUE if row[6] == track}
        last = next(reversed(own.values()))
        boxes = []
        for t in range(FRAMES):
            _, _, a, b, c, d, _ = own.get(t, last)
            where = f'xtl="{a}" ytl="{b}" xbr="{c}" ybr="{d}" z_order="0"'
            boxes.append(f'<box frame="{t}" outside="{int(t not in own)}" keyframe="1" {where}/>')
        tracks.append(f'<track id="{track}" label="{last[1]}">{"".join(boxes)}</track>\n')
    size = f"<original_size><width>{W}</width><height>{H}</height></original_size>"
    head = '<?xml version="1.0" encoding="utf-8"?>\n<annotations><version>1.1</version>\n'
    return f"{head}<meta><task>{size}</task></meta>\n{''.join(tracks)}</annotations>"


def coco_text(video=None):
    images = [
        {"id": 10 + t, "file_name": f"a/{t:06d}.jpg", "width": W, "height": H, "frame_id": t}
        for t in range(FRAMES)
    ]
    notes = [
        {"id": i, "image_id": 10 + t, "category_id": NAMES.index(n) + 1, "track_id": k,
         "bbox": [a, b, c - a, d - b]}
        for i, (t, n, a, b, c, d, k) in enumerate(TRUE)
    ]  # fmt: skip
    names = [{"id": i + 1, "name": name} for i, name in enumerate(NAMES)]
    return json.dumps({"images": images, "annotations": notes, "categories": names})


def youtube_text():
    notes = []
    for track in (1, 2, 3):
        own = {row[0]: row for row in TRUE if row[6] == track}
        boxes = [[x[2], x[3], x[4] - x[2], x[5] - x[3]] if (x := own.get(t)) else None
                 for t in range(FRAMES)]  # fmt: skip
        category = NAMES.index(next(iter(own.values()))[1]) + 1
        notes.append({"id": track, "video_id": 2, "category_id": category, "bboxes": boxes})
    names = [{"id": i + 1, "name": name} for i, name in enumerate(NAMES)]
    videos = [{"id": 1, "name": "b.mp4"}, {"id": 2, "name": "a.mp4"}]
    return json.dumps({"videos": videos, "annotations": notes, "categories": names})


def label_studio_text():
    results = []
    for track in (1, 2, 3):
        own = [row for row in TRUE if row[6] == track]
        keys = [own[0], own[-1]]  # what moves in a line needs no more
        sequence = [
            {"frame": t + 1, "enabled": t != own[-1][0] or t == FRAMES - 1, "rotation": 0,
             "x": a / W * 100, "y": b / H * 100, "width": (c - a) / W * 100,
             "height": (d - b) / H * 100, "time": t / 10}
            for t, _, a, b, c, d, _ in keys
        ]  # fmt: skip
        value = {"framesCount": FRAMES, "sequence": sequence, "labels": [own[0][1]]}
        results.append({"id": f"r{track}", "type": "videorectangle", "value": value})
    task = {
        "data": {"video": "/data/upload/1/3f2a91bc-a.mp4"},
        "annotations": [{"result": results}],
    }
    other = {"data": {"video": "b.mp4"}, "annotations": []}
    return json.dumps([other, task])


def yolo_folder(folder):
    for t in range(FRAMES):
        rows = (
            f"{NAMES.index(n)} {(a + c) / 2 / W} {(b + d) / 2 / H} {(c - a) / W} {(d - b) / H} {k}"
            for frame, n, a, b, c, d, k in TRUE
            if frame == t
        )
        (folder / "a").mkdir(exist_ok=True)
        (folder / "a" / f"a_{t + 1}.txt").write_text("\n".join(rows))
    (folder / "names.txt").write_text("\n".join(NAMES))


def written(name, text, names=()):
    def write(folder):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
        if names:
            (folder / "names.txt").write_text("\n".join(names))

    return write


FORMATS = {
    "our CSV": written("a.csv", csv_text()),
    "MOTChallenge, numbers": written("a.txt", mot_text(), NAMES),
    "MOTChallenge, numbers from 0": written("a.txt", mot_text(NAMES.index), NAMES),
    "MOTChallenge, names": written("a.txt", mot_text(str)),
    "MOTChallenge's folders": written("a/gt.txt", mot_text(str)),
    "CVAT for video": written("a.xml", cvat_text()),
    "COCO": written("a.json", coco_text()),
    "YouTube-VIS, of all films": written("annotations.json", youtube_text()),
    "Label Studio": written("a.json", label_studio_text()),
    "YOLO": yolo_folder,
}


@pytest.mark.parametrize("kind", FORMATS)
def test_a_format_gives_the_boxes_of_our_csv_to_half_a_pixel(tmp_path, kind):
    FORMATS[kind](tmp_path)
    if kind == "MOTChallenge's folders":
        (tmp_path / "a").rename(tmp_path / "gt")
        (tmp_path / "a").mkdir()
        (tmp_path / "gt").rename(tmp_path / "a" / "gt")
    found = boxes_of(film(tmp_path))
    by_place = lambda row: (row[0], row[1], row[2])  # noqa: E731
    mine = sorted(((b.frame, b.name, *b.edges) for b in found), key=by_place)
    true = sorted((row[:6] for row in TRUE), key=by_place)
    assert [row[:2] for row in mine] == [row[:2] for row in true]
    np.testing.assert_allclose([r[2:] for r in mine], [r[2:] for r in true], atol=0.5)
    tracks = [{b.track for b in found if b.name == name} for name in NAMES]
    assert [len(each) for each in tracks] == [2, 1]
    assert all(str(tmp_path) in b.where for b in found)


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
    (tmp_path / "a.xml").write_text(cvat_text())
    items = datumaro.Dataset.import_from(str(tmp_path / "a.xml"), "cvat")
    seen = sorted((one.attributes["frame"], *box.get_bbox()) for one in items
                  for box in one.annotations if not box.attributes.get("outside"))  # fmt: skip
    true = sorted((t, a, b, c - a, d - b) for t, _, a, b, c, d, _ in TRUE)
    np.testing.assert_allclose(seen, true, atol=0.5)
    (tmp_path / "a.txt").write_text(mot_text())
    table = motmetrics.io.loadtxt(tmp_path / "a.txt", fmt="mot16", min_confidence=-1)
    seen = sorted((frame - 1, row.X + 1, row.Y + 1, row.Width, row.Height)
                  for (frame, _), row in table.iterrows())  # fmt: skip
    np.testing.assert_allclose(seen, true, atol=0.5)


def test_a_box_has_its_file_and_line(tmp_path):
    written("a.csv", csv_text())(tmp_path)
    assert boxes_of(film(tmp_path))[0].where == f"{tmp_path / 'a.csv'}, line 2"


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_is_one_sentence_with_file_and_line(tmp_path, kind):
    name, text, words = WRONG[kind]
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    if kind.startswith("YOLO"):
        (tmp_path / "names.txt").write_text("\n".join(NAMES))
    with pytest.raises(DemoError) as caught:
        boxes_of(film(tmp_path))
    said = str(caught.value)
    assert words in said
    assert said.startswith(str(tmp_path / Path(name).parts[0]))
    assert "\n" not in said
    assert len(said) < 600


def test_boxes_must_be_in_one_place(tmp_path):
    with pytest.raises(
        DemoError, match=r"no boxes are beside the film: they must be one of a\.csv"
    ):
        file_of(tmp_path / "a.mp4")
    (tmp_path / "a.csv").write_text("")
    (tmp_path / "a.txt").write_text("")
    with pytest.raises(DemoError, match=r"both a\.csv and a\.txt"):
        file_of(tmp_path / "a.mp4")
    with pytest.raises(DemoError, match="no regular file"):
        reader(tmp_path / "gone.csv")
