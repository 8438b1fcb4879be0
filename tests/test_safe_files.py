"""Files appear whole or not at all."""

import pytest

from gril_jax import safe_files
from gril_jax.errors import RunError


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
