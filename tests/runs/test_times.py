"""times.jsonl: clocks are joined to their rows, and no run depends on them."""

import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import run_dir, times


@pytest.fixture
def path(tmp_path):
    """A run of four rows."""
    with run_dir.create(tmp_path / "run", RunConfig(), device="cpu", experiment="train") as run:
        for i in range(4):
            run.log(phase="ppo", env_steps=i, seconds=i / 2, env_steps_per_s=2.0)
        run.finish_phase("policy", {})
    return tmp_path / "run"


ROWS = [{"phase": "ppo", "env_steps": i} for i in range(4)]


def test_clocks_are_in_a_file_of_their_own_and_readers_join_them(path):
    assert run_dir.read_metrics(path) == ROWS
    row = {"phase": "ppo", "env_steps": 3, "seconds": 1.5, "env_steps_per_s": 2.0}
    assert run_dir.read_metrics(path, clocks=True)[3] == row
    assert times.started(path)[:2] == "20"


def test_of_two_times_of_a_row_the_later_one_counts(path):
    with run_dir.resume(path) as run:
        run.note_time(line=4, seconds=7.0)
    assert run_dir.read_metrics(path, clocks=True)[3]["seconds"] == 7.0


def test_a_damaged_line_is_refused_and_without_the_file_the_run_goes_on(path):
    file = path / times.FILE
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join([*lines[:2], b"{]\n", *lines[3:]]))
    fault = r"times\.jsonl: line 3 is not JSON: remove it, and the run goes on without its times"
    with pytest.raises(RunError, match=fault):
        run_dir.read_metrics(path, clocks=True)
    with pytest.raises(RunError, match=fault):
        run_dir.resume(path)
    file.unlink()
    with run_dir.resume(path) as run:
        run.log(phase="later", seconds=1.0)
    *rows, last = run_dir.read_metrics(path, clocks=True)
    assert rows == ROWS
    assert last["seconds"] == 1.0
    assert run_dir.read_metrics(path) == [*ROWS, {"phase": "later"}]


def test_a_last_line_that_was_cut_short_is_left_out(path):
    file = path / times.FILE
    file.write_bytes(file.read_bytes()[:-3])
    with run_dir.resume(path) as run:
        assert run.said == [f"the last line of {file} was cut short, and is left out"]
    assert "seconds" not in run_dir.read_metrics(path, clocks=True)[3]
