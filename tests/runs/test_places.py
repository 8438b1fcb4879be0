"""Where a run finds its demonstrations: from any directory, and after it was moved."""

import shutil

import pytest

from gril_jax.config import DemosConfig, RunConfig
from gril_jax.runs import places, run_dir
from gril_jax.safe_files import digest


def _set(folder, text="a set"):
    folder.mkdir(parents=True)
    (folder / "demos.json").write_text(text)
    return folder


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder with a demonstration set, `mine`, and a run that learns from it, `runs/one`."""
    folder = tmp_path / "project"
    _set(folder / "mine")
    monkeypatch.chdir(folder)
    config = RunConfig(demos=DemosConfig(path="mine"))
    with run_dir.create(folder / "runs" / "one", config, device="cpu", experiment="train") as run:
        run.finish_phase("demos", {"sha256": digest(folder / "mine" / "demos.json")})
    return folder


def _found(run):
    return run_dir.read_config(run).demos.path


def test_where_it_began_the_path_is_as_it_was_given(project):
    assert _found(project / "runs" / "one") == "mine"


def test_from_another_directory_the_set_is_where_it_was(project, tmp_path, monkeypatch):
    _set(tmp_path / "mine", "another set")
    monkeypatch.chdir(tmp_path)
    assert _found(project / "runs" / "one") == str(project / "mine")


def test_a_run_that_was_moved_alone_finds_the_set_where_it_was(project, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = shutil.move(project / "runs" / "one", tmp_path / "far")
    assert _found(run) == str(project / "mine")


def test_moved_together_they_find_each_other(project, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    moved = project.rename(tmp_path / "moved")
    assert _found(moved / "runs" / "one") == str(moved / "mine")


def test_a_set_in_the_folder_of_the_run_is_found(project, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = shutil.move(project / "runs" / "one", tmp_path / "far" / "run")
    shutil.move(project / "mine", tmp_path / "far" / "mine")
    assert _found(run) == str(tmp_path / "far" / "mine")
    (run / "times.jsonl").unlink()  # without it, too
    assert _found(run) == str(tmp_path / "far" / "mine")


def test_another_set_of_the_name_is_not_taken_and_what_is_gone_is_named(project, tmp_path):
    (project / "mine").rename(tmp_path / "hidden")
    _set(project / "runs" / "mine", "another set")
    found = _found(project / "runs" / "one")
    assert found == "mine"
    with pytest.raises(run_dir.RunError, match=r"set mine is gone, .* say where with --demos"):
        places.require(run_dir.Path(found), "it is needed")


def test_a_set_that_was_changed_in_its_place_is_the_one_that_is_told(project, tmp_path):
    (project / "mine" / "demos.json").write_text("changed")
    assert _found(project / "runs" / "one") == "mine"


def test_the_user_has_the_last_word(project, tmp_path):
    there = tmp_path / "hidden"
    config = run_dir.read_config(project / "runs" / "one", demos=there)
    assert config.demos.path == str(there)
    run_dir.create(tmp_path / "own", RunConfig(), device="cpu").close()
    with pytest.raises(run_dir.RunError, match="holds its own demonstrations, so it has no use"):
        run_dir.read_config(tmp_path / "own", demos=there)
