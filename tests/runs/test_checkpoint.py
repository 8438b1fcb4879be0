"""Checkpoints: bit for bit there and back; damage is named; halves are never chosen."""

import hashlib
import json
import os
import subprocess
import sys
import threading
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.errors import RunError
from gril_jax.runs.checkpoints import checkpoint, latest, manifest, steps
from gril_jax.runs.checkpoints.checkpoint import CheckpointWriter, restore, save, write
from gril_jax.runs.checkpoints.state_leaves import digest, host_copy, like_of, to_device


class State(NamedTuple):
    params: dict
    key: jax.Array
    step: jax.Array


def _state(seed=0):
    key = jax.random.key(seed)
    params = {
        "w": jax.random.normal(key, (3, 4)),
        "b": jnp.array([jnp.nan, -0.0, jnp.inf]),
        "half": jnp.array([1.5, -2.0], jnp.bfloat16),
        "empty": jnp.zeros((0, 3)),
        "mask": jnp.array([True, False]),
        "odd / name": (jnp.uint8(255), None, [jnp.int32(-7)]),
    }
    return State(params, jax.random.split(key, 3), jnp.int32(12))


def _bits(leaf):
    if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key):
        leaf = jax.random.key_data(leaf)
    return np.asarray(leaf).tobytes()


def _same(a, b):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert (x.dtype, x.shape, _bits(x)) == (y.dtype, y.shape, _bits(y))


@pytest.fixture
def saved(tmp_path):
    return save(tmp_path / "checkpoints", 1000, _state())


def _file_of(path, leaf):
    """The data file of a leaf, found through the manifest."""
    entry = next(e for e in manifest(path)["leaves"] if e["path"] == leaf)
    files = (path / "arrays" / entry["file"]).iterdir()
    return next(f for f in files if not f.name.startswith("."))


def _flip(file, position=-1, bit=0):
    data = bytearray(file.read_bytes())
    data[position] ^= 1 << bit
    file.write_bytes(data)


# --- there and back


def test_a_state_comes_back_bit_for_bit(saved):
    _same(restore(saved, _state(seed=1)), _state())


@pytest.mark.parametrize("impl", ["threefry2x32", "rbg"])
def test_keys_keep_their_generator(tmp_path, impl):
    key = jax.random.key(5, impl=impl)
    again = restore(save(tmp_path, 0, key), jax.random.key(0, impl=impl))
    assert jax.random.key_impl(again) == jax.random.key_impl(key)
    _same(again, key)


@pytest.mark.parametrize("state", [{}, (), {"a": None}, jnp.zeros((0,)), {"a": 1.5, "b": 2}])
def test_small_states_come_back(tmp_path, state):
    again = restore(save(tmp_path, 0, state), state)
    assert jax.tree.structure(again) == jax.tree.structure(state)
    jax.tree.map(np.testing.assert_array_equal, again, state)


def test_what_comes_back_is_on_the_device_and_may_be_donated(saved):
    again = restore(saved, _state())
    assert all(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(again))
    double = jax.jit(lambda s: s._replace(step=s.step * 2), donate_argnums=0)
    assert double(again).step == 24
    _same(restore(saved, _state()), _state())


def test_the_manifest_tells_the_step_and_the_leaves(saved):
    content = manifest(saved)
    assert content["step"] == 1000
    leaf = next(e for e in content["leaves"] if e["path"] == "params.w")
    assert (leaf["shape"], leaf["dtype"], leaf["key"]) == ([3, 4], "float32", None)
    key = next(e for e in content["leaves"] if e["path"] == "key")
    assert (key["shape"], key["dtype"]) == ([3, 2], "uint32")
    assert key["key"] is not None


def test_nothing_is_logged(tmp_path):
    code = (
        "import jax.numpy as jnp, pathlib, sys\n"
        "from gril_jax.runs.checkpoints.checkpoint import restore, save\n"
        "state = {'w': jnp.ones(3)}\n"
        "restore(save(pathlib.Path(sys.argv[1]), 0, state), state)\n"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    environment = os.environ | {"JAX_PLATFORMS": "cpu"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


# --- which one


def test_the_latest_is_the_one_with_the_most_steps(tmp_path):
    assert latest(tmp_path) is None
    assert latest(tmp_path / "nowhere") is None
    for step in (9, 100, 20):
        save(tmp_path, step, {"a": jnp.int32(step)})
    assert steps(tmp_path) == [9, 20, 100]
    assert restore(latest(tmp_path), {"a": jnp.int32(0)})["a"] == 100


def test_only_the_newest_are_kept_where_that_is_asked(tmp_path):
    for step in range(5):
        write(tmp_path, step, host_copy({"a": jnp.int32(step)}), keep=2)
    assert steps(tmp_path) == [3, 4]
    assert sorted(os.listdir(tmp_path)) == [f"{3:012d}", f"{4:012d}"]


def test_a_step_is_saved_once(tmp_path):
    save(tmp_path, 3, {"a": jnp.int32(1)})
    with pytest.raises(RunError, match="exists already, but a step is saved once"):
        save(tmp_path, 3, {"a": jnp.int32(2)})


def test_a_checkpoint_that_was_cut_short_is_never_chosen(tmp_path, monkeypatch):
    first = save(tmp_path, 1, {"a": jnp.int32(1)})

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("gril_jax.runs.checkpoints.checkpoint.os.rename", killed)
        with pytest.raises(KeyboardInterrupt):
            save(tmp_path, 2, {"a": jnp.int32(2)})
    assert latest(tmp_path) == first
    assert os.listdir(tmp_path) == [first.name]


def test_what_a_killed_process_left_is_ignored_and_replaced(tmp_path):
    part = tmp_path / f".{2:012d}.part"
    (part / "arrays").mkdir(parents=True)
    (tmp_path / f"{3:012d}").mkdir()  # no manifest, so not complete
    assert latest(tmp_path) is None
    second = save(tmp_path, 2, {"a": jnp.int32(2)})
    assert latest(tmp_path) == second
    assert not part.exists()


# --- damage


@pytest.mark.parametrize("leaf", ["params.w", "key", "step", "params.odd / name.2.0"])
def test_a_flipped_bit_is_found_and_the_leaf_named(saved, leaf):
    _flip(_file_of(saved, leaf))
    with pytest.raises(RunError, match=r"is damaged: leaf .* has changed") as caught:
        restore(saved, _state())
    assert f"leaf {leaf} " in str(caught.value)


def test_no_flipped_bit_anywhere_goes_unnoticed(saved):
    files = [file for file in sorted(saved.rglob("*")) if file.is_file()]
    assert len(files) > 10
    for file in files:
        good = file.read_bytes()
        for position in {0, len(good) // 3, len(good) // 2, len(good) - 1}:
            _flip(file, position, bit=position % 8)
            with pytest.raises(RunError, match="is damaged"):
                restore(saved, _state())
            file.write_bytes(good)
    _same(restore(saved, _state()), _state())


def test_every_file_that_is_missing_or_cut_short_is_noticed(saved):
    for file in [file for file in sorted(saved.rglob("*")) if file.is_file()]:
        good = file.read_bytes()
        file.write_bytes(good[:-1])
        with pytest.raises(RunError):
            restore(saved, _state())
        file.unlink()
        with pytest.raises(RunError):
            restore(saved, _state())
        file.write_bytes(good)


def test_a_leaf_whose_file_is_missing_is_named(saved):
    _file_of(saved, "params.w").unlink()
    with pytest.raises(RunError, match=r"leaf params\.w is missing a file"):
        restore(saved, _state())


def test_a_manifest_that_was_edited_is_refused(saved):
    file = saved / "manifest.json"
    file.write_text(file.read_text().replace('"step": 1000', '"step": 1001'))
    with pytest.raises(RunError, match="its manifest has changed"):
        manifest(saved)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "{}", '"sha256"', "\ud800"])
def test_a_manifest_that_is_none_is_refused(saved, text):
    (saved / "manifest.json").write_bytes(text.encode(errors="surrogatepass"))
    with pytest.raises(RunError, match="its manifest cannot be read"):
        manifest(saved)


def test_a_folder_that_is_no_checkpoint_is_told(tmp_path):
    with pytest.raises(RunError, match=r"is not a complete checkpoint: it has no manifest"):
        restore(tmp_path, {})


def test_a_file_that_is_not_of_the_checkpoint_does_no_harm(saved):
    (saved / "notes.txt").write_text("mine")
    _same(restore(saved, _state()), _state())


# --- another structure


def _changed(**params):
    state = _state()
    return state._replace(params=state.params | params)


@pytest.mark.parametrize(
    ("like", "fault"),
    [
        (_changed(extra=jnp.zeros(1)), "lacks the leaf params.extra"),
        (_changed(w=None), "has a leaf params.w that the state to fill lacks"),
        (_changed(w=jnp.zeros((4, 3))), "params.w .* float32.3, 4., .* float32.4, 3. there"),
        (_changed(w=jnp.zeros((3, 4), jnp.int32)), "params.w .* has int32"),
        (_state()._replace(key=jnp.zeros((3, 2), jnp.uint32)), "leaf key .* is a .* key of"),
    ],
)
def test_a_state_of_another_structure_is_refused_by_leaf(saved, like, fault):
    with pytest.raises(RunError, match=fault):
        restore(saved, like)


def test_keys_of_another_generator_are_refused(tmp_path):
    path = save(tmp_path, 0, jax.random.key(0, impl="rbg"))
    with pytest.raises(RunError, match=r"leaf \(root\) .* is a rbg key of"):
        restore(path, jax.random.key(0))


# --- the leaves of a state

LEAVES = {"w": jnp.arange(6.0).reshape(2, 3), "key": jax.random.key(3), "n": jnp.int32(4), "x": 1.5}


def test_leaves_have_names_kinds_and_their_own_memory():
    leaves = host_copy(LEAVES)
    assert [leaf.path for leaf in leaves] == ["key", "n", "w", "x"]
    assert leaves[0].key == str(jax.random.key_impl(LEAVES["key"]))
    assert [leaf.key for leaf in leaves[1:]] == [None] * 3
    assert all(leaf.array.flags.owndata for leaf in leaves)
    np.testing.assert_array_equal(leaves[2].array, LEAVES["w"])


def test_a_copy_outlives_the_donation_of_what_was_copied():
    # A view of a buffer on a CPU would change with it.
    double = jax.jit(lambda x: x * 2, donate_argnums=0)
    state = jnp.arange(1000.0)
    (leaf,) = host_copy(state)
    for _ in range(3):
        state = double(state)
    np.testing.assert_array_equal(leaf.array, np.arange(1000.0))


def test_shapes_are_known_without_values():
    for leaf, copied in zip(jax.tree.leaves(LEAVES), host_copy(LEAVES), strict=True):
        assert like_of(leaf) == (copied.key, copied.array.dtype.name, copied.array.shape)


def test_a_leaf_comes_back_on_the_device():
    for leaf, copied in zip(jax.tree.leaves(LEAVES), host_copy(LEAVES), strict=True):
        back = to_device(copied.array, leaf)
        assert back.dtype == jnp.asarray(leaf).dtype
        assert bool((back == leaf).all())


def test_the_digest_is_sha_256_over_heads_and_bits():
    total = hashlib.sha256()
    for leaf in host_copy(LEAVES):
        total.update(repr((leaf.path, leaf.key, leaf.array.dtype.name, leaf.array.shape)).encode())
        total.update(leaf.array.tobytes())
    assert digest(LEAVES) == total.hexdigest()


@pytest.mark.parametrize(
    "change",
    [
        {"w": LEAVES["w"].reshape(3, 2)},
        {"w": LEAVES["w"].at[0, 0].set(-0.0)},
        {"n": jnp.uint32(4)},
        {"key": jax.random.key_data(LEAVES["key"])},
        {"extra": jnp.zeros(0)},
    ],
)
def test_states_that_differ_in_anything_have_other_digests(change):
    assert digest({**LEAVES, **change}) != digest(LEAVES)


# --- in a thread


@pytest.fixture
def gate(monkeypatch):
    """Holds the thread up until it is opened; the steps that were written follow."""
    event, written = threading.Event(), []

    def write(folder, step, leaves, keep, metrics):
        assert event.wait(30)
        written.append((step, float(leaves[0].array)))

    monkeypatch.setattr(checkpoint, "write", write)
    return event, written


def test_a_state_is_written_as_it_was_when_it_was_saved(tmp_path):
    with CheckpointWriter(tmp_path, keep=2) as writer:
        for step in range(4):
            writer.save(step, {"x": jnp.full(3, step)})
        assert writer.longest_stall_s > 0
    assert steps(tmp_path) == [2, 3]
    state = restore(latest(tmp_path), {"x": jnp.zeros(3, jnp.int32)})
    np.testing.assert_array_equal(state["x"], 3)


def test_saving_does_not_wait_for_the_disk_and_leaving_does(gate, tmp_path):
    event, written = gate
    with CheckpointWriter(tmp_path, keep=2) as writer:
        assert not writer.busy
        writer.save(1, jnp.float32(0.5))
        assert writer.busy
        assert written == []
        event.set()
        writer.wait()
        assert not writer.busy
        writer.save(2, jnp.float32(1.5))
    assert written == [(1, 0.5), (2, 1.5)]


def test_what_it_counts_on_is_brought_to_the_disk_first(gate, tmp_path):
    event, written = gate
    event.set()
    with CheckpointWriter(tmp_path, keep=2, before=lambda: written.append("rows")) as writer:
        writer.save(1, jnp.float32(0.5))
    assert written == ["rows", (1, 0.5)]


def test_an_error_of_the_thread_comes_up_at_the_next_call(tmp_path):
    (tmp_path / "file").touch()

    def failed():
        writer = CheckpointWriter(tmp_path / "file", keep=1)
        writer.save(1, jnp.zeros(1))
        return writer

    with pytest.raises(RunError, match="cannot be written to"):
        failed().save(2, jnp.zeros(1))
    with pytest.raises(RunError, match="cannot be written to"):
        failed().wait()
    with pytest.raises(RunError, match="cannot be written to"), failed():
        pass
    with pytest.raises(ZeroDivisionError), failed():  # what went wrong first is what counts
        raise ZeroDivisionError


# --- full disks

_FILL = """
import pathlib, resource, sys
import jax.numpy as jnp, numpy as np
from gril_jax.runs.checkpoints.checkpoint import latest, restore, save
from gril_jax.errors import RunError
folder = pathlib.Path(sys.argv[1])
noise = jnp.asarray(np.random.default_rng(0).normal(size=(200, 200)))
first = save(folder, 1, noise)
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))  # no file may grow beyond this
try:
    save(folder, 2, noise)
except RunError as error:
    print(error)
assert latest(folder) == first
assert (restore(first, noise) == noise).all()
print([path.name for path in folder.iterdir()])
"""


def test_a_full_disk_is_one_sentence_and_the_checkpoint_before_stays(tmp_path):
    environment = os.environ | {"JAX_PLATFORMS": "cpu"}
    command = [sys.executable, "-c", _FILL, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    sentence, left = done.stdout.splitlines()
    assert sentence.startswith(f"there is no space left to write to {tmp_path} ")
    assert json.loads(left.replace("'", '"')) == [f"{1:012d}"]
