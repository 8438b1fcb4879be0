"""Demo sets on disk: what is written is read, and nothing else is."""

import errno
import hashlib
import json

import numpy as np
import pytest

from gril_jax.demos.demo import Demo, Source, Tracks, trim_static_tail
from gril_jax.demos.demo_set import demo_batch, load_demo_set
from gril_jax.demos.files import write_demo_set
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import DemoError

CLASSES = ("goal", "robot", "cup")
OPTIONS = {
    "task": "tidy",
    "classes": CLASSES,
    "half_extent": 1.5,
    "fps": 8.0,
    "source": "drawn by hand",
}


def tracks(frames=5, label=(0, 1, 2), seed=0):
    rng = np.random.default_rng(seed)
    shape = (frames, len(label), 2)
    return Tracks(
        rng.uniform(-1, 1, shape).astype(np.float32),
        rng.uniform(0.1, 1, shape).astype(np.float32),
        np.array(label, np.int32),
        rng.random(shape[:2]) < 0.9,
    )


def demo(name="a", frames=5, **options):
    pixels = np.full((frames, 16, 16, 3), 200, np.uint8)
    fields = {"tracks": tracks(frames), "trimmed": 3, "outcome": "success"} | options
    return Demo(name, pixels, **fields)


@pytest.fixture
def saved(tmp_path):
    write_demo_set(tmp_path / "set", [demo("a"), demo("b", 7, trimmed=0)], **OPTIONS)
    return tmp_path / "set"


def edit(folder, change):
    header = json.loads((folder / "demos.json").read_text())
    change(header)
    (folder / "demos.json").write_text(json.dumps(header))


def rewrite(folder, arrays, number=0):
    """Replaces a tracks file, with a digest that fits."""
    np.savez(folder / f"{number:03d}.npz", **arrays)
    digest = hashlib.sha256((folder / f"{number:03d}.npz").read_bytes()).hexdigest()
    edit(folder, lambda h: h["demos"][number].update(tracks_sha256=digest))


# ---- saving and loading


def test_what_is_saved_is_loaded(saved):
    loaded = load_demo_set(saved)
    assert (loaded.task, loaded.classes, loaded.source) == ("tidy", CLASSES, "drawn by hand")
    assert (loaded.half_extent, loaded.fps) == (1.5, 8.0)
    assert [entry.name for entry in loaded] == ["a", "b"]
    first = loaded[0]
    assert (len(first), first.trimmed, first.outcome) == (5, 3, "success")
    assert loaded.objects(first) == list(CLASSES)
    for field, array in tracks()._asdict().items():
        found = getattr(loaded[0].tracks, field)
        np.testing.assert_array_equal(found, array)
        assert found.dtype == array.dtype
    assert len(loaded[1].frames) == len(read_video(saved / "001.mp4")) == 7


def test_frames_of_the_imported_video_are_kept_and_cut_with_the_demonstration(tmp_path):
    source = Source(np.arange(0, 15, 3, dtype=np.int32), np.arange(5) / 10)
    write_demo_set(tmp_path / "set", [demo("a", source=source), demo("b")], **OPTIONS)
    first, second = load_demo_set(tmp_path / "set")
    np.testing.assert_array_equal(first.source, source)
    assert first.source.frame.dtype == np.int32
    assert first.during(slice(2, 4)).source.frame.tolist() == [6, 9]
    assert second.source is None
    assert first == demo("a", source=source) != demo("a")


@pytest.mark.parametrize(
    "changes",
    [
        {"source_frame": np.array([0, 1, 2, 3, -4], np.int32)},
        {"source_frame": np.arange(4, dtype=np.int32)},
        {"source_frame": np.array([0, 2, 1, 3, 4], np.int32)},
        {"source_time": np.array([0, 1, 2, 3, np.nan])},
        {"source_time": None},
    ],
)
def test_frames_that_cannot_be_those_of_a_video_are_refused(saved, changes):
    source = {"source_frame": np.arange(5, dtype=np.int32), "source_time": np.arange(5) / 10}
    arrays = tracks()._asdict() | source | changes
    rewrite(saved, {name: x for name, x in arrays.items() if x is not None})
    with pytest.raises(DemoError, match="must each be 5 numbers that never decrease"):
        load_demo_set(saved)


def test_stages_are_kept_where_they_are_known(tmp_path, saved):
    stages = {"lid open": 2, "shoe in": -1}
    write_demo_set(tmp_path / "new", [demo("a", stages=stages), demo("b")], **OPTIONS)
    assert [e.stages for e in load_demo_set(tmp_path / "new")] == [stages, None]
    header = json.loads((tmp_path / "new" / "demos.json").read_text())
    assert header["schema_version"] == 1
    assert "stages" not in header["demos"][1]
    assert load_demo_set(saved)[0].stages is None


@pytest.mark.parametrize(
    ("stages", "words"),
    [
        ([3], "stages must give each stage's frame by its name"),
        ({"lid": 1.5}, "stage 'lid' must have a frame or -1, not 1.5"),
        ({"lid": -2}, "stage 'lid' must have a frame or -1, not -2"),
    ],
)
def test_malformed_stages_are_named(saved, stages, words):
    edit(saved, lambda h: h["demos"][0].update(stages=stages))
    with pytest.raises(DemoError, match=words):
        load_demo_set(saved)


def test_saving_again_replaces_the_whole_set_and_leaves_nothing_beside_it(saved):
    write_demo_set(saved, [demo("c")], **OPTIONS)
    assert [entry.name for entry in load_demo_set(saved)] == ["c"]
    assert sorted(p.name for p in saved.iterdir()) == ["000.mp4", "000.npz", "demos.json"]
    assert [p.name for p in saved.parent.iterdir()] == ["set"]


def test_an_empty_folder_is_filled_and_missing_parents_are_made(tmp_path):
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "deep" / "er"):
        write_demo_set(folder, [demo()], **OPTIONS)
        assert len(load_demo_set(folder)) == 1


def test_a_folder_of_other_things_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(DemoError, match="not empty and no demo set"):
        write_demo_set(tmp_path, [demo()], **OPTIONS)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(DemoError, match="this is a file"):
        write_demo_set(tmp_path / "thesis.tex", [demo()], **OPTIONS)


def test_an_interrupted_write_leaves_the_old_set_and_no_rubbish(saved):
    def broken():
        yield demo("x")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_demo_set(saved, broken(), **OPTIONS)
    assert [entry.name for entry in load_demo_set(saved)] == ["a", "b"]
    assert [p.name for p in saved.parent.iterdir()] == ["set"]


def test_a_full_disk_is_one_sentence_and_leaves_nothing(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(DemoError, match=r"set: .* because there is no space left \("):
        write_demo_set(tmp_path / "set", [demo()], **OPTIONS)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: [], "at least 1 demonstration"),
        (lambda: [demo(), demo()], "two demonstrations are called 'a'"),
        (lambda: [demo(frames=1)], "at least 2 frames"),
        (lambda: [demo(outcome="maybe")], "outcome 'maybe' is not one of"),
        (lambda: [demo(tracks=tracks(4))], r"center is float32 \(4, 3, 2\), it must be"),
        (lambda: [demo(tracks=tracks(label=(0, 3)))], "label must lie in 0 to 2"),
    ],
)
def test_unfit_demonstrations_are_not_saved(tmp_path, make, words):
    with pytest.raises(DemoError, match=words):
        write_demo_set(tmp_path / "set", make(), **OPTIONS)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda h: h.update(schema_version=2), "schema_version must be 1, not 2"),
        (lambda h: h.pop("schema_version"), "schema_version must be 1, not None"),
        (lambda h: h.pop("fps"), "the field 'fps' is missing"),
        (lambda h: h.update(fps=0), "fps must be above 0"),
        (lambda h: h.update(half_extent="wide"), "half_extent must be float, not 'wide'"),
        (lambda h: h.update(half_extent=float("nan")), "half_extent must be above 0"),
        (lambda h: h.update(classes=[1]), "classes must be a list of names"),
        (lambda h: h.update(demos=[]), "demos is empty"),
        (lambda h: h.update(demos=["a"]), r"demos\[0\]: must be an object"),
        (lambda h: h["demos"][1].pop("objects"), r"demos\[1\]: the field 'objects' is missing"),
        (lambda h: h["demos"][1].update(frames=True), "frames must be int, not True"),
        (lambda h: h["demos"][1].update(frames=1), "at least 2 frames, not 1"),
        (lambda h: h["demos"][1].update(trimmed=-1), "trimmed must be at least 0"),
        (lambda h: h["demos"][1].update(outcome="meh"), "outcome must be one of"),
        (lambda h: h["demos"][1].update(name="a"), "two demonstrations are called 'a'"),
        (lambda h: h["demos"][1].update(objects=["cat"] * 3), "the object 'cat' is not one"),
        (lambda h: h["demos"][0].update(tracks="009.npz"), r"009\.npz: the file of 'a' is mi"),
        (lambda h: h["demos"][0].update(frames=6), r"center is float32 \(5, 3, 2\), it must"),
        (lambda h: h["demos"][0]["objects"].reverse(), "label does not agree"),
        (lambda h: h["demos"][0]["objects"].pop(), r"center is .*must be float32 \(5, 2, 2\)"),
    ],
)
def test_headers_that_are_wrong_are_refused_with_field_and_remedy(saved, change, words):
    edit(saved, change)
    with pytest.raises(DemoError, match=words) as caught:
        load_demo_set(saved)
    assert str(saved) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "[" * 100_000])
def test_a_header_that_is_no_object_is_refused(saved, text):
    (saved / "demos.json").write_text(text)
    with pytest.raises(DemoError, match=r"demos\.json"):
        load_demo_set(saved)


def test_a_folder_without_header_is_refused(tmp_path):
    with pytest.raises(DemoError, match="no demo set here"):
        load_demo_set(tmp_path)


@pytest.mark.parametrize("name", ["000.mp4", "001.npz"])
def test_changed_and_missing_files_are_noticed(saved, name):
    whole = (saved / name).read_bytes()
    (saved / name).write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    with pytest.raises(DemoError, match=rf"{name}: the contents differ from the digest"):
        load_demo_set(saved)
    (saved / name).unlink()
    with pytest.raises(DemoError, match=rf"{name}: the file of .* is missing"):
        load_demo_set(saved)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: a.pop("seen"), "the array 'seen' is missing"),
        (lambda a: a.update(center=a["center"].astype(float)), "center is float64"),
        (lambda a: a.update(label=a["label"][:2]), r"label is int32 \(2,\)"),
        (lambda a: a.update(size=a["size"] * 0), "size must be above 0"),
        (lambda a: a.update(center=a["center"] * np.nan), "must be finite"),
        (lambda a: a.update(center=a["center"] + np.float32(1e30)), "1e.30, but must be at most"),
        (lambda a: a.update(size=a["size"] + np.float32(1e3)), "size of object 1 in frame"),
        (lambda a: a.update(label=a["label"] + 1), "label must lie in 0 to 2"),
        (lambda a: a.update(label=np.array([None] * 3)), "not an npz file of plain arrays"),
    ],
)
def test_arrays_that_break_the_schema_are_refused(saved, change, words):
    arrays = tracks()._asdict()
    change(arrays)
    rewrite(saved, arrays)
    with pytest.raises(DemoError, match=words):
        load_demo_set(saved)


# ---- trimming


def still(frames, moving_until, kind=2):
    center = np.zeros((frames, 3, 2), np.float32)
    center[:moving_until, kind, 0] = np.linspace(-1, -0.1, moving_until)
    size = np.ones_like(center)
    return Tracks(center, size, np.array([0, 1, 2], np.int32), np.ones((frames, 3), bool))


@pytest.mark.parametrize(
    ("frames", "moving_until", "kept"),
    [(50, 20, 26), (50, 48, 50), (50, 0, 6), (1, 0, 1)],
)
def test_tail_is_cut_a_margin_after_the_last_block_has_arrived(frames, moving_until, kept):
    assert trim_static_tail(still(frames, moving_until), CLASSES, robots=("robot",)) == kept


@pytest.mark.parametrize("kind", [0, 1])
def test_robot_and_goal_do_not_hold_the_tail(kind):
    assert trim_static_tail(still(50, 40, kind), CLASSES, robots=("robot",)) == 6


def test_detector_noise_below_the_tolerance_does_not_hold_the_tail():
    noisy = still(50, 20)
    noise = np.random.default_rng(0).normal(0, 0.001, noisy.center.shape).astype(np.float32)
    assert (
        trim_static_tail(noisy._replace(center=noisy.center + noise), CLASSES, robots=("robot",))
        == 26
    )


# ---- batches and splits


def test_batch_pads_with_the_last_frame_and_keeps_lengths(saved):
    loaded = load_demo_set(saved)
    batch = demo_batch(loaded)
    assert batch.center.shape == (2, 7, 3, 2)
    assert batch.length.tolist() == [5, 7]
    for b, track in enumerate(demo.tracks for demo in loaded):
        for t in range(7):
            source = min(t, len(track.center) - 1)
            np.testing.assert_array_equal(batch.center[b, t], track.center[source])
            np.testing.assert_array_equal(batch.size[b, t], track.size[source])
    assert batch.is_robot.tolist() == [[False, True, False]] * 2
    assert batch.label.tolist() == [[0, 1, 2]] * 2
    assert np.asarray(batch.present).all()


def test_object_order_is_label_then_x_of_the_first_frame(tmp_path):
    mixed = tracks(label=(2, 1, 2, 0))
    mixed.center[0, 0, 0], mixed.center[0, 2, 0] = 0.5, -0.5
    shuffled = Tracks(*(np.take(a, [3, 0, 1, 2], -2 if a.ndim > 2 else -1) for a in mixed))
    demos = [demo("a", tracks=mixed), demo("b", tracks=shuffled)]
    write_demo_set(tmp_path / "set", demos, **OPTIONS)
    batch = demo_batch(load_demo_set(tmp_path / "set"))
    assert batch.label.tolist() == [[0, 1, 2, 2]] * 2
    np.testing.assert_array_equal(batch.center[0], batch.center[1])
    np.testing.assert_array_equal(batch.center[0], mixed.center[:, [3, 1, 2, 0]])


def test_batch_refuses_unknown_names_and_different_objects(tmp_path):
    demos = [demo("a"), demo("b", tracks=tracks(label=(0, 1)))]
    write_demo_set(tmp_path / "set", demos, **OPTIONS)
    loaded = load_demo_set(tmp_path / "set")
    with pytest.raises(DemoError, match="'a' has goal, robot, cup and 'b' has goal, robot"):
        demo_batch(loaded)
    with pytest.raises(DemoError, match="no demonstration 'z'; there are a, b"):
        demo_batch(loaded, ["z"])
    with pytest.raises(DemoError, match="at least 1 demonstration"):
        demo_batch(loaded, [])
