"""Files appear whole or not at all; a folder has one writer (`test_run_dir` has two processes)."""

import os
from urllib.parse import unquote

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gril_jax import safe_files
from gril_jax.errors import RunError
from gril_jax.safe_files import take_lock


def test_a_file_is_replaced_whole(tmp_path):
    file = tmp_path / "a.json"
    safe_files.write_whole(file, "old")
    safe_files.write_whole(file, "new")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.json", "new")]


def test_a_write_that_is_cut_short_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "a.json"
    safe_files.write_whole(file, "old")

    def full(path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(safe_files, "sync", full)
    with (
        pytest.raises(RunError, match=r"no space left to write to .* stays readable"),
        safe_files.writing(tmp_path),
    ):
        safe_files.write_whole(file, "new")
    assert file.read_text() == "old"


def test_a_lock_is_taken_once_and_again_after_it_is_closed(tmp_path):
    lock = take_lock(tmp_path)
    assert (tmp_path / "lock").read_text() == f"{os.getpid()}\n"
    with pytest.raises(RunError, match=f"is being written by process {os.getpid()}: wait for it"):
        take_lock(tmp_path)
    lock.close()
    take_lock(tmp_path).close()


def test_a_look_at_the_lock_leaves_the_note_of_who_had_it(tmp_path):
    (tmp_path / "lock").write_text("123\n")
    held = take_lock(tmp_path, note=False)
    with pytest.raises(RunError, match="is being written by process 123:"):
        take_lock(tmp_path)
    held.close()
    assert (tmp_path / "lock").read_text() == "123\n"


def test_a_lock_without_a_note_is_of_an_unknown_process(tmp_path):
    with take_lock(tmp_path, note=False), pytest.raises(RunError, match="by process unknown:"):
        take_lock(tmp_path)


_NAMES = st.text(st.one_of(st.sampled_from("/_.% a-1\\:\0é"), st.characters()), max_size=300)


@settings(max_examples=300, deadline=None)
@given(name=_NAMES, other=_NAMES)
def test_file_names_are_unique_and_reversible(name, other):
    made = safe_files.file_name(name)
    raw = made.encode(errors="surrogatepass")
    assert len(raw) <= 200
    assert made.isprintable()
    assert not {"/", "\\", "\0"} & {*made}
    assert made[:1] != "."
    if len(raw) < 200 - 3:  # which no digest ends
        assert unquote(made, errors="surrogatepass") == name
    assert (made == safe_files.file_name(other)) == (name == other)
