"""MAGICAL's pickles: frames come out, nothing runs, whatever the file holds."""

import gzip
import os
import pickle
import sys
import types
from collections import OrderedDict

import numpy as np
import pytest
from support import scenes

from gril_jax.demos.magical_pickles import list_magical, read_actions, read_magical
from gril_jax.errors import DemoError

FRAMES = np.arange(3 * 8 * 8 * 3, dtype=np.uint8).reshape(3, 8, 8, 3)


class _Foreign(tuple):
    """A trajectory class that pickles under the name the public files use."""

    def __new__(cls, *fields):
        return super().__new__(cls, fields)

    def __getnewargs__(self):
        return tuple(self)


@pytest.fixture
def trajectory(monkeypatch):
    """Makes the public files' module importable for pickling, in this test only."""
    _Foreign.__module__ = "milbench.baselines.saved_trajectories"
    _Foreign.__qualname__ = _Foreign.__name__ = "MILBenchTrajectory"
    module = types.ModuleType(_Foreign.__module__)
    module.MILBenchTrajectory = _Foreign
    for name in ("milbench", "milbench.baselines"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, _Foreign.__module__, module)
    return _Foreign


def content(trajectory, frames=FRAMES):
    observations = [OrderedDict(allo=frame, ego=frame[::-1]) for frame in frames]
    acts = np.zeros(len(frames) - 1, np.int64)
    steps = trajectory(acts, observations, [0.0] * len(acts), [{"eval_score": 0.0}] * len(acts))
    return {"trajectory": steps, "score": 1.0, "env_name": "MatchRegions-Demo-v0"}


def with_actions(trajectory, actions):
    """A demonstration's content with other actions."""
    good = content(trajectory)
    _, *rest = good["trajectory"]
    return good | {"trajectory": trajectory(actions, *rest)}


def write(path, data):
    path.write_bytes(gzip.compress(data))
    return path


@pytest.mark.parametrize("protocol", [3, 4, 5])
def test_frames_score_and_task_are_read_from_any_binary_protocol(tmp_path, trajectory, protocol):
    path = write(tmp_path / "a.pkl.gz", pickle.dumps(content(trajectory), protocol))
    demo = read_magical(path)
    np.testing.assert_array_equal(demo.frames, FRAMES)
    assert (demo.env_name, demo.score) == ("MatchRegions-Demo-v0", 1.0)


@pytest.mark.parametrize("package", [b"core", b"_core"])
def test_numpys_old_and_new_module_names_mean_the_same(tmp_path, trajectory, package):
    data = pickle.dumps(content(trajectory), 3)  # names are plain lines in protocol 3
    current = b"numpy._core." if b"numpy._core." in data else b"numpy.core."
    assert current in data
    path = write(tmp_path / "a.pkl.gz", data.replace(current, b"numpy." + package + b"."))
    np.testing.assert_array_equal(read_magical(path).frames, FRAMES)


def test_reading_imports_none_of_the_modules_that_a_file_names(tmp_path, trajectory, monkeypatch):
    path = write(tmp_path / "a.pkl.gz", pickle.dumps(content(trajectory), 4))
    for name in list(sys.modules):
        if name.startswith("milbench"):
            monkeypatch.delitem(sys.modules, name)
    read_magical(path)
    assert not any(name.startswith("milbench") for name in sys.modules)


class _Call:
    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize(
    ("function", "name"),
    [
        (os.mkdir, ".mkdir"),
        (eval, ".eval"),
        (getattr, ".getattr"),
    ],
)
@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_a_pickle_that_calls_something_is_refused_and_calls_nothing(
    tmp_path, function, name, protocol
):
    target = tmp_path / "ran"
    argument = f"__import__('os').mkdir({str(target)!r})" if function is eval else str(target)
    data = pickle.dumps({"trajectory": _Call(function, argument)}, protocol)
    path = write(tmp_path / "bad.pkl.gz", data)
    for read in (read_magical, read_actions):
        words = rf"bad\.pkl\.gz: the pickle asks for .*{name}.*not loaded"
        with pytest.raises(DemoError, match=words):
            read(path)
        assert not target.exists()


def test_dotted_names_do_not_reach_into_allowed_ones(tmp_path):
    data = b"\x80\x04\x8c\x05numpy\x8c\x0dndarray.dumps\x93."
    with pytest.raises(DemoError, match=r"numpy\.ndarray\.dumps"):
        read_magical(write(tmp_path / "a.pkl.gz", data))


def test_persistent_ids_and_extension_codes_are_refused(tmp_path):
    for data in (b"\x80\x04\x8c\x01xQ.", b"\x80\x04\x82\x01."):
        with pytest.raises(DemoError, match="not a whole pickle"):
            read_magical(write(tmp_path / "a.pkl.gz", data))


def test_arrays_of_objects_are_refused(tmp_path, trajectory):
    bad = content(trajectory)
    bad["trajectory"][1][0]["allo"] = np.array([None, 1], object)
    with pytest.raises(DemoError, match="not a whole pickle"):
        read_magical(write(tmp_path / "a.pkl.gz", pickle.dumps(bad, 4)))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.98])
def test_a_file_cut_short_is_refused(tmp_path, trajectory, share):
    data = gzip.compress(pickle.dumps(content(trajectory), 4))
    path = tmp_path / "cut.pkl.gz"
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DemoError, match=r"cut\.pkl\.gz: not a whole"):
        read_magical(path)


@pytest.mark.parametrize("flip", range(10, 400, 13))
def test_damaged_pickles_end_in_a_sentence_or_in_frames(tmp_path, trajectory, flip):
    data = bytearray(pickle.dumps(content(trajectory), 4))
    data[flip] ^= 0x5A
    path = write(tmp_path / "a.pkl.gz", bytes(data))
    sentence = None
    try:
        frames = read_magical(path).frames
    except DemoError as error:
        sentence = str(error)
    if sentence is None:
        assert frames.dtype == np.uint8
    else:
        assert sentence.startswith(str(path))
        assert "\n" not in sentence


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.pop("score"), "no MAGICAL demonstration"),
        (lambda c: c.update(trajectory=[1, 2]), "no MAGICAL demonstration"),
        (lambda c: c.update(score="high"), "no MAGICAL demonstration"),
        (lambda c: c.update(env_name=3), "'env_name' should be text"),
        (lambda c: c["trajectory"][1][0].pop("allo"), "no MAGICAL demonstration"),
        (lambda c: [o.update(allo=np.zeros((8, 8))) for o in c["trajectory"][1]], "float64"),
    ],
)
def test_a_pickle_of_something_else_is_refused(tmp_path, trajectory, change, words):
    bad = content(trajectory)
    change(bad)
    with pytest.raises(DemoError, match=words):
        read_magical(write(tmp_path / "a.pkl.gz", pickle.dumps(bad, 4)))


def test_files_that_are_no_gzip_or_missing_are_refused(tmp_path):
    (tmp_path / "a.pkl.gz").write_bytes(b"hello")
    with pytest.raises(DemoError, match="not a whole gzip file"):
        read_magical(tmp_path / "a.pkl.gz")
    with pytest.raises(DemoError, match="cannot be read"):
        read_magical(tmp_path / "b.pkl.gz")


def test_a_file_that_unpacks_without_end_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("gril_jax.demos.magical_pickles._MAX_BYTES", 1000)
    with pytest.raises(DemoError, match="unpacks to more than"):
        read_magical(write(tmp_path / "a.pkl.gz", bytes(5000)))


def test_files_are_listed_by_name_and_an_empty_folder_is_an_error(tmp_path):
    with pytest.raises(DemoError, match=r"holds no \*\.pkl\.gz"):
        list_magical(tmp_path)
    for name in ("b.pkl.gz", "a.pkl.gz", "notes.txt"):
        (tmp_path / name).touch()
    assert [path.name for path in list_magical(tmp_path)] == ["a.pkl.gz", "b.pkl.gz"]


def test_big_endian_and_fortran_arrays_are_read_as_they_were(tmp_path, trajectory):
    fortran = [np.asfortranarray(frame) for frame in FRAMES]
    good = content(trajectory, fortran)
    good["trajectory"][2].append(np.arange(3, dtype=">f8"))
    demo = read_magical(write(tmp_path / "a.pkl.gz", pickle.dumps(good, 4)))
    np.testing.assert_array_equal(demo.frames, FRAMES)


@pytest.mark.parametrize("kind", ["<i8", ">i8", "<i4", "u1"])
def test_actions_are_read_apart_as_whole_numbers(tmp_path, trajectory, kind):
    numbers = [0, 17, 9]
    bad = with_actions(trajectory, np.array(numbers, kind))
    actions = read_actions(write(tmp_path / "a.pkl.gz", pickle.dumps(bad, 4)))
    assert actions.dtype == np.int64
    assert actions.tolist() == numbers


@pytest.mark.parametrize(
    ("actions", "words"),
    [
        (np.array([0, 18]), "action 18 is none of 0 to 17"),
        (np.array([-1]), "action -1 is none of 0 to 17"),
        (np.array([0.0]), r"actions are float64 \(1,\)"),
        (np.array([[0]]), r"actions are int64 \(1, 1\)"),
        (np.array([], int), r"actions are int64 \(0,\)"),
        ([0, 1], "begins with an array of actions"),
    ],
)
def test_other_actions_are_refused(tmp_path, trajectory, actions, words):
    path = write(tmp_path / "a.pkl.gz", pickle.dumps(with_actions(trajectory, actions), 4))
    with pytest.raises(DemoError, match=words):
        read_actions(path)


@pytest.mark.skipif(
    not (scenes.shared_data() / "magical").is_dir(), reason="no human demonstrations here"
)
def test_a_public_recording_is_121_frames_of_a_success():
    demo = read_magical(list_magical(scenes.shared_data() / "magical")[0])
    assert demo.frames.shape == (121, 384, 384, 3)
    assert (demo.env_name, demo.score) == ("MatchRegions-Demo-v0", 1.0)
    assert demo.frames[0, 0, 0].tolist() == [231, 231, 234]
