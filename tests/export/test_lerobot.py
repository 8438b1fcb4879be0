"""LeRobot datasets: videos of a camera, boxes, and segments written back."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from support import kitchen_films
from support.lerobot_sets import CAMERA, STORIES, dataset, frames_of, indexed, shade, write
from support.paths import TESTS

from gril_jax.demos.formats import lerobot
from gril_jax.demos.importing import import_videos
from gril_jax.demos.vision.timed import pictures
from gril_jax.demos.vision.video import write_video
from gril_jax.errors import ConfigError, DemoError
from gril_jax.export.lerobot import annotate
from gril_jax.export.lerobot_progress import Trace, write_progress

pytest.importorskip("pyarrow")


def test_a_dataset_of_version_2_1_has_a_file_an_episode(tmp_path):
    folder = tmp_path / "data"
    dataset(folder)
    info = json.loads((folder / "meta" / "info.json").read_text())
    info |= {"codebase_version": "v2.1", "chunks_size": 1000}
    info["video_path"] = (
        "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
    )
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    rows = [json.dumps({"episode_index": n, "length": 1}) for n in (1, 0)]
    (folder / "meta" / "episodes.jsonl").write_text("\n".join(rows) + "\n")
    for number, told in enumerate(STORIES):
        film = folder / f"videos/chunk-000/{CAMERA}/episode_{number:06d}.mp4"
        film.parent.mkdir(parents=True, exist_ok=True)
        write_video(film, shade(told, number), 10.0)
    found = lerobot.opened(folder)
    films = lerobot.films(found, CAMERA)
    assert [film.name for film in films] == ["episode_000000", "episode_000001"]
    assert [len(film.times) for film in films] == [len(told.boxes) for told in STORIES]
    assert lerobot.boxes_in(found)(films[1])
    (folder / "meta" / "episodes.jsonl").write_text("{\n")
    with pytest.raises(DemoError, match=r"episodes\.jsonl, line 1: not JSON"):
        lerobot.films(found, CAMERA)


def test_films_and_boxes_of_a_camera_are_imported(tmp_path):
    found = dataset(tmp_path / "data")
    films = lerobot.films(found, lerobot.camera_of(found, None))
    assert [film.name for film in films] == ["episode_000000", "episode_000001"]
    assert [len(film.times) for film in films] == [len(told.boxes) for told in STORIES]
    second = pictures(films[1], 10.0)
    assert len(second) == len(STORIES[1].boxes)
    np.testing.assert_allclose(second[:5].mean(axis=(1, 2, 3)), 140 + np.arange(5), atol=2)
    boxes = lerobot.boxes_in(found)
    for film, told in zip(films, STORIES, strict=True):
        for one in boxes(film):
            true = told.boxes[one.frame, kitchen_films.CLASSES.index(one.name)]
            np.testing.assert_allclose(one.edges, true, atol=0.5)
    made = import_videos(tmp_path / "data", robot=["hand"])
    assert made.names == ["episode_000000", "episode_000001"]


def test_a_dataset_that_lerobot_wrote_is_read(tmp_path):
    """Written by lerobot 0.4.4, videos in AV1: two episodes of 12 and 9 frames in one file."""
    found = lerobot.opened(TESTS / "data" / "lerobot")
    films = lerobot.films(found, lerobot.camera_of(found, None))
    assert [len(film.times) for film in films] == [12, 9]
    for number, film in enumerate(films):
        shown = pictures(film, 10.0).mean(axis=(1, 2, 3))
        np.testing.assert_allclose(shown, 40 + 60 * number + 5 * np.arange(len(shown)), atol=3)
        boxes = lerobot.boxes_in(found)(film)
        cups = {one.frame: one.edges for one in boxes if one.name == "cup"}
        assert sorted(cups) == [t for t in range(len(film.times)) if t != 3]
        assert all(edges == (10 + 2 * t, 20, 22 + 2 * t, 32) for t, edges in cups.items())
        assert sum(one.name == "hand" for one in boxes) == len(film.times)
    annotate(found, tmp_path / "new", {"episode_000000": [0.5, 1.0]}, ["a", "b"])
    assert lerobot.frames(lerobot.opened(tmp_path / "new"), "subtask_index")[0][:6] == [0] * 6


def test_boxes_may_be_files_in_the_dataset(tmp_path):
    found = dataset(tmp_path, feature=False)
    (tmp_path / "boxes").mkdir()
    for number, told in enumerate(STORIES):
        rows = kitchen_films.tracked(told)
        kitchen_films.write_csv(tmp_path / "boxes" / f"episode_{number:06d}.csv", rows)
    films = lerobot.films(found, CAMERA)
    assert len(lerobot.boxes_in(found)(films[1])) > 3 * len(films[1].times)


def test_segments_become_subtask_annotations_of_a_copy(tmp_path):
    found = dataset(tmp_path / "data")
    before = {p: p.read_bytes() for p in (tmp_path / "data").rglob("*") if p.is_file()}
    ends = {"episode_000001": [1.0, 2.0]}
    annotate(found, tmp_path / "new", ends, ["cup down", "spoon in"])
    assert {p: p.read_bytes() for p in before} == before
    again = lerobot.opened(tmp_path / "new")
    index = lerobot.frames(again, "subtask_index")
    assert set(index[0]) == {2}
    assert index[1][:11] == [0] * 11
    assert set(index[1][11:]) == {1}
    for file in lerobot.data_files(again):
        schema = lerobot.parquet().read_schema(file)
        assert [*json.loads(schema.metadata[b"huggingface"])["info"]["features"]] == schema.names
    table = lerobot.parquet().read_table(tmp_path / "new" / "meta" / "subtasks.parquet")
    assert table.to_pydict() == {
        "subtask_index": [0, 1, 2], "subtask": ["cup down", "spoon in", "not segmented"]
    }  # fmt: skip
    assert again.info["features"]["subtask_index"]["dtype"] == "int64"
    with pytest.raises(DemoError, match="none of its episodes is among"):
        annotate(found, tmp_path / "more", {"a": [1.0]}, ["x"])
    assert not (tmp_path / "more").exists()


def linked(folder, to):
    """Moves every file to a store of blobs, as the cache of Hugging Face, with a link in place."""
    to.mkdir()
    for number, file in enumerate([p for p in folder.rglob("*") if p.is_file()]):
        file.rename(to / str(number))
        file.symlink_to(os.path.relpath(to / str(number), file.parent))


def test_a_dataset_of_links_is_imported_and_annotated(tmp_path):
    dataset(tmp_path / "hub" / "snapshots" / "abc")
    linked(tmp_path / "hub" / "snapshots" / "abc", tmp_path / "hub" / "blobs")
    found = lerobot.opened(tmp_path / "hub" / "snapshots" / "abc")
    films = lerobot.films(found, CAMERA)
    assert [len(film.times) for film in films] == [len(told.boxes) for told in STORIES]
    annotate(found, tmp_path / "deep" / "er" / "new", {"episode_000000": [1.0]}, ["a"])
    copied = lerobot.films(lerobot.opened(tmp_path / "deep" / "er" / "new"), CAMERA)
    assert [film.times for film in copied] == [film.times for film in films]


def test_a_folder_of_videos_may_be_a_link_to_another_disk(tmp_path):
    found = dataset(tmp_path / "data")
    (tmp_path / "data" / "videos").rename(tmp_path / "disk")
    (tmp_path / "data" / "videos").symlink_to(tmp_path / "disk")
    assert len(lerobot.films(found, CAMERA)) == 2


def test_stages_go_by_the_frame_where_the_timestamp_is_a_clock(tmp_path):
    found = dataset(tmp_path / "data")
    rows = [row for number, told in enumerate(STORIES) for row in frames_of(number, told)]
    clock = [row | {"timestamp": 1.7e9 + 0.13 * n} for n, row in enumerate(rows)]
    write(tmp_path / "data/data/chunk-000/file-000.parquet", clock)
    annotate(found, tmp_path / "new", {"episode_000001": [1.0, 2.0]}, ["a", "b"])
    index = lerobot.frames(lerobot.opened(tmp_path / "new"), "subtask_index")[1]
    assert index == [0] * 11 + [1] * (len(index) - 11)


def test_hidden_files_beside_the_data_are_passed_over(tmp_path):
    found = dataset(tmp_path)
    (tmp_path / "data" / "chunk-000" / "._file-000.parquet").write_bytes(b"Mac OS X")
    assert len(lerobot.data_files(found)) == 1


def test_rows_that_are_not_the_frames_are_refused(tmp_path):
    """As where the camera ran at another rate than the robot."""
    found = dataset(tmp_path)
    rows = [
        row for number, told in enumerate(STORIES) for row in list(frames_of(number, told))[::3]
    ]
    write(tmp_path / "data/chunk-000/file-000.parquet", rows)
    films = lerobot.films(found, CAMERA)
    with pytest.raises(
        DemoError, match=r"episode_000000 has \d+ frames at 10 a second, but \d+ row"
    ):
        lerobot.boxes_in(found)(films[0])


def test_what_is_wrong_with_a_dataset_is_a_sentence(tmp_path, monkeypatch):
    found = dataset(tmp_path)
    info = dict(found.info)
    for change, words in (
        ({"codebase_version": "v2.0"}, "codebase_version is 'v2.0'.*v3.0 or v2.1"),
        ({"fps": 0}, "fps is 0, but must be"),
        ({"features": {}}, "no feature is a video"),
        ({"features": {CAMERA: []}}, "must be dict"),
        ({"features": info["features"] | {"front": {"dtype": "image"}}}, "there are no camera"),
        ({"video_path": "../../{video_key}.mp4"}, "leads out of the dataset"),
        ({"video_path": "{secret}.mp4"}, "which is not known"),
    ):
        (tmp_path / "meta" / "info.json").write_text(json.dumps(info | change))
        camera = "front" if "features" in change else CAMERA
        with pytest.raises(DemoError, match=words):
            lerobot.films(now := lerobot.opened(tmp_path), lerobot.camera_of(now, camera))
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    for file, words in (
        ("data", "boxes: *the column|not a parquet"),
        ("meta/episodes", "not a par"),
    ):
        (tmp_path / file / "chunk-000" / "file-000.parquet").write_bytes(b"PAR1 is not enough")
        with pytest.raises(DemoError, match=words):
            lerobot.boxes_in(found) if file == "data" else lerobot.films(found, CAMERA)
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 9\n"
    (tmp_path / "data" / "chunk-000" / "file-000.parquet").write_text(pointer)
    with pytest.raises(DemoError, match="a Git LFS pointer"):
        lerobot.boxes_in(found)
    monkeypatch.setattr("importlib.import_module", _missing)
    with pytest.raises(ConfigError, match="pyarrow is not installed"):
        lerobot.episodes(found)
    assert lerobot.is_dataset(Path(tmp_path))


def _missing(name):
    raise ImportError(name)


def test_clocks_and_numbers_of_a_dataset_that_are_wrong_are_refused(tmp_path):
    folder = tmp_path / "data"
    dataset(folder)
    where = folder / "meta" / "info.json"
    info = json.loads(where.read_text())
    where.write_text(json.dumps(info | {"fps": 30}))
    with pytest.raises(DemoError, match=r"has 10 frames a second, but .*info\.json says fps 30"):
        lerobot.films(lerobot.opened(folder), CAMERA)
    where.write_text(json.dumps(info | {"codebase_version": "v2.1", "chunks_size": 0}))
    (folder / "meta" / "episodes.jsonl").write_text('\n{"episode_index": 0}\n\n')
    with pytest.raises(DemoError, match="chunks_size must be a whole number from 1, not '0'"):
        lerobot.films(lerobot.opened(folder), CAMERA)


def test_a_dataset_without_boxes_is_said(tmp_path):
    found = dataset(tmp_path / "data", feature=False)
    with pytest.raises(DemoError, match=r"the dataset has no boxes; .* boxes/episode_000000\.csv"):
        lerobot.boxes_in(found)(lerobot.films(found, CAMERA)[0])


# --- progress


def test_progress_has_the_columns_that_lerobot_weighs_samples_by(tmp_path):
    made, rows = indexed(tmp_path / "data")
    # Half the frames of episode 1, without its end; episode 0 was not among the videos.
    time = np.arange(0, 1.5, 0.2)
    trace = Trace(np.linspace(-1.2, -0.1, len(time)).astype(np.float32), time)
    out = tmp_path / "sarm_progress.parquet"
    own = [row["frame_index"] for row in rows if row["episode_index"] == 1]
    found = write_progress(made, out, {"episode_000001": trace}, source="run")
    assert found == (len(own), len(rows))
    table = lerobot.parquet().read_table(out)
    assert table.schema.metadata[b"reward_model_path"] == b"run"
    kinds = {name: str(table.schema.field(name).type) for name in table.column_names}
    assert kinds == {
        "index": "int64", "episode_index": "int64", "frame_index": "int64",
        "progress_sparse": "float",
    }  # fmt: skip
    assert table["index"].to_pylist() == list(range(len(rows)))
    values = np.array(table["progress_sparse"].to_pylist())
    mine = np.array(table["episode_index"].to_pylist()) == 1
    assert np.isnan(values[~mine]).all()
    expected = np.clip(1 + np.interp(np.array(own) / 10, *trace[::-1]), 0, 1)
    np.testing.assert_allclose(values[mine], expected, atol=1e-6)
    assert values[mine][0] == 0
    np.testing.assert_allclose(values[mine][-1], 0.9, atol=1e-6)  # held to the end


def test_progress_of_other_videos_is_refused_and_nothing_is_written(tmp_path):
    made, _ = indexed(tmp_path / "data")
    trace = Trace(np.zeros(2, np.float32), np.arange(2.0))
    with pytest.raises(DemoError, match="none of its episodes is among the run's videos"):
        write_progress(made, tmp_path / "p.parquet", {"kitchen": trace}, source="run")
    assert not (tmp_path / "p.parquet").exists()
