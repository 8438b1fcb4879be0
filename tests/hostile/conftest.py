"""The folders of an honest user, which hostile inputs are put into."""

import os

import pytest
from support.run_folders import save_demos, save_run


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """A folder with a small demonstration set and a small run, of which tests take copies."""
    base = tmp_path_factory.mktemp("honest")
    save_demos(base / "set", names=("one", "two"))
    save_run(base / "run", pretrain=1, ppo=0)
    return base


@pytest.fixture
def home(tmp_path, honest, monkeypatch):
    """The user's folder: copies of the honest ones, and a file that must stay as it is."""
    os.system(f"cp -r {honest} {tmp_path / 'home'}")
    (tmp_path / "home" / "letter.txt").write_text("dear reader\n" * 100)
    monkeypatch.chdir(tmp_path / "home")
    return tmp_path / "home"
