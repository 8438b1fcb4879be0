"""Files of one's own tasks: what a reference names, what may be run, what goes wrong in them."""

import os
import sys

import pytest
from gril_jax.envs.user_tasks import files
from support import own_task


@pytest.fixture(autouse=True)
def fresh(monkeypatch, tmp_path):
    """A process that was told nothing yet, and a user who has named nothing yet."""
    monkeypatch.setattr(files, "_named", {})
    monkeypatch.setattr(files, "_moved", {})
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(sys, "path", [*sys.path])


@pytest.fixture
def forget(monkeypatch):
    """Ends the process, as it were: what was noted on disk is left."""
    return lambda: monkeypatch.setattr(files, "_named", {})


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("gone.py", "gone.py does not exist"),
        ("my_task.py:", "must end with the name of a function"),
        ("my_task.py:os.system", "must end with the name of a function"),
        ("my_task.py:make()", "must end with the name of a function"),
        ("my_\ntask.py:make", "has letters that cannot be printed"),
        ("my\0task.py:make", "has letters that cannot be printed"),
        ("my_task.py:make:make", "must be FILE.py:FUNCTION"),
    ],
)
def test_what_names_no_function_of_a_file_is_refused(name, fault):
    with pytest.raises(ValueError, match=fault):
        files.reference(name)


def test_a_reference_is_absolute(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert str(files.reference("a/../my_task.py:make")) == f"{tmp_path}/my_task.py:make"
    assert files.is_reference("my_task.py:make")
    assert not files.is_reference("my_package.my_task:SPEC")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("def make(): pass", "make"),
        ("from os import path\nclass Task: pass\ndef _own(): pass\nmine = lambda: Task()\n"
         "def build(): return Task()", "build"),
        ("async def make(): pass\ndef other(): pass", "has the functions make, other, so the task"),
        ("def _make(): pass", "has no public function, so the task must be named as in a.py:make"),
        ("def make(:", "line 1: SyntaxError"),
        ("def make(): pass\0", "cannot contain null bytes"),
    ],
)  # fmt: skip
def test_a_file_alone_names_its_only_public_function_and_is_not_run(tmp_path, text, found):
    file = tmp_path / "a.py"
    file.write_text(f"{text}\n")
    if found.isidentifier():
        assert files.reference(str(file)) == files.Reference(file, found)
    else:
        with pytest.raises(ValueError, match=found):
            files.reference(str(file))
    with pytest.raises(ValueError, match=r"the detector file .*gone\.py does not exist"):
        files.reference(str(tmp_path / "gone.py"), "detector")


def test_a_file_that_was_never_named_is_not_run(tmp_path):
    path = own_task.write(tmp_path)
    (tmp_path / "my_task.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n{own_task.TASK}")
    with pytest.raises(ValueError, match="was never named on a command line as it is now"):
        files.load(f"{path}:make")
    with pytest.raises(ValueError, match=f"add --task {path}:make"):
        files.require(f"{path}:make")
    assert not (tmp_path / "ran").exists()
    files.name(f"{path}:make")
    assert callable(files.load(f"{path}:make"))
    assert (tmp_path / "ran").exists()


def test_what_was_named_is_run_by_later_commands_until_it_changes(tmp_path, forget):
    path = own_task.write(tmp_path)
    files.name(f"{path}:make")
    forget()
    files.require(f"{path}:make")
    path.write_text(path.read_text() + "# more\n")
    with pytest.raises(ValueError, match="never named"):
        files.require(f"{path}:make")


def test_a_file_of_another_place_with_the_same_contents_was_not_named(tmp_path, forget):
    path = own_task.write(tmp_path)
    files.name(f"{path}:make")
    (tmp_path / "other").mkdir()
    other = own_task.write(tmp_path / "other")
    with pytest.raises(ValueError, match="never named"):
        files.require(f"{other}:make")


def test_a_run_refuses_a_file_that_has_changed_or_gone(tmp_path):
    path = own_task.write(tmp_path)
    files.name(f"{path}:make")
    digest = files.digest(f"{path}:make")
    assert files.require(f"{path}:make", digest) == digest
    path.write_text(path.read_text() + "# more\n")
    files.name(f"{path}:make")
    with pytest.raises(ValueError, match="has been changed since the run began"):
        files.require(f"{path}:make", digest)
    path.unlink()
    with pytest.raises(ValueError, match="does not exist: if it lies elsewhere now, say where"):
        files.require(f"{path}:make", digest)


def test_a_file_that_was_moved_is_found_where_the_user_says(tmp_path):
    path = own_task.write(tmp_path)
    digest = files.digest(f"{path}:make")
    moved = path.rename(tmp_path / "moved.py")
    files.moved(f"{path}:make", f"{moved}:make")
    assert files.require(f"{path}:make", digest) == digest
    assert files.load(f"{path}:make")().classes == own_task.CLASSES


def test_a_file_that_was_moved_with_its_run_is_run_if_it_was_named_where_it_was(tmp_path, forget):
    path = own_task.write(tmp_path)
    digest = files.digest(f"{path}:make")
    place = tmp_path / "moved" / "my_task.py"
    place.parent.mkdir()
    files.look_for(f"{path}:make", digest, [place])  # it is where it was
    path.rename(place)
    files.look_for(f"{path}:make", digest, [tmp_path / "nowhere" / "my_task.py", place])
    with pytest.raises(ValueError, match=rf"was never named .* add --task {place}:make"):
        files.require(f"{path}:make", digest)
    place.rename(path)
    files._moved.clear()
    files.name(f"{path}:make")
    path.rename(place)
    forget()
    files.look_for(f"{path}:make", digest, [place])
    assert files.require(f"{path}:make", digest) == digest
    assert files.load(f"{path}:make")().classes == own_task.CLASSES


def test_a_file_of_other_contents_is_not_taken_for_the_one_of_a_run(tmp_path):
    path = own_task.write(tmp_path)
    digest = files.name(f"{path}:make") and files.digest(f"{path}:make")
    place = tmp_path / "moved" / "my_task.py"
    place.parent.mkdir()
    place.write_text(path.read_text() + "# more\n")
    path.unlink()
    files.look_for(f"{path}:make", digest, [place])
    with pytest.raises(ValueError, match="does not exist: if it lies elsewhere now, say where"):
        files.require(f"{path}:make", digest)


def test_byte_code_beside_a_file_is_not_run(tmp_path):
    path = own_task.write(tmp_path)
    cache = tmp_path / "__pycache__" / f"my_task.{sys.implementation.cache_tag}.pyc"
    cache.parent.mkdir()
    cache.write_bytes(b"not what was read")
    files.name(f"{path}:make")
    assert callable(files.load(f"{path}:make"))
    assert cache.read_bytes() == b"not what was read"


def test_a_file_imports_others_of_its_folder(tmp_path):
    (tmp_path / "my_helper_of_test_files.py").write_text("SPEED = 3\n")
    path = tmp_path / "my_task.py"
    path.write_text("from my_helper_of_test_files import SPEED\ndef make():\n    return SPEED\n")
    files.name(f"{path}:make")
    assert files.load(f"{path}:make")() == 3


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("x = 1\ndef mak():\n    pass\n", "has no make"),
        ("make = 3\n", "make is a int, not a function"),
        ("x = 1\nraise RuntimeError('of no\\nuse')\n", "line 2: RuntimeError: of no$"),
        ("import sys\nsys.exit(3)\n", r"line 2: it called sys.exit\(3\)"),
        ("def make(:\n", "line 1: SyntaxError: "),
        ("import not_installed_at_all\n", "line 1: ModuleNotFoundError: No module named"),
        ("\0", "SyntaxError: source code string cannot contain null bytes|null bytes"),
        ("# coding: nonsense\n", "SyntaxError: unknown encoding"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_sentence_with_its_line(tmp_path, text, fault):
    path = tmp_path / "my_task.py"
    path.write_text(text)
    files.name(f"{path}:make")
    with pytest.raises(ValueError, match=fault) as caught:
        files.load(f"{path}:make")
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_folders_and_pipes_are_no_files(tmp_path):
    (tmp_path / "folder.py").mkdir()
    os.mkfifo(tmp_path / "pipe.py")
    for name in ("folder.py", "pipe.py"):
        with pytest.raises(ValueError, match="is no regular file"):
            files.name(f"{tmp_path / name}:make")
    with pytest.raises(ValueError, match="does not exist"):
        files.name(f"{tmp_path / 'gone.py'}:make")


def test_a_record_that_cannot_be_kept_or_read_hinders_nobody(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    path = own_task.write(tmp_path)
    files.name(f"{path}:make")
    assert callable(files.load(f"{path}:make"))
