"""metrics.jsonl and times.jsonl: what is cut came after a mark; no run depends on its clocks."""

import resource

import pytest

from gril_jax.config import RunConfig
from gril_jax.errors import RunError
from gril_jax.runs import json_lines, run_dir


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_file_is_cut_and_goes_on_from_there(tmp_path, count):
    rows, marks = json_lines.JsonLines(tmp_path / "metrics.jsonl"), []
    for i in range(4):
        marks.append(rows.mark())
        rows.append({"i": i})
    assert rows.cut(count) == 4 - count
    assert rows.mark() == marks[count]
    rows.append({"i": 9})
    rows.sync()
    kept = json_lines.read_rows(rows.file, [rows.mark()], whole=True)
    assert [row["i"] for row in kept] == [*range(count), 9]
    rows.close()


def test_a_phase_that_begins_again_leaves_the_rows_of_others(path):
    with run_dir.resume(path) as run:
        for i in range(2):
            run.log(phase="sac", env_steps=i)
        assert run.newest("sac", "fresh", pytest.fail) == ("fresh", 0)
        assert run.metrics()[-1]["phase"] == "ppo"
        run.log(phase="sac", env_steps=5)
        run.newest("third", "fresh", pytest.fail)
    assert run_dir.read_metrics(path) == [*ROWS, {"phase": "sac", "env_steps": 5}]


def test_a_phase_that_failed_begins_again_without_taking_away_what_finished_behind_it(path):
    with run_dir.resume(path) as run:
        run.log(phase="failed", env_steps=1)
        run.log(phase="behind", env_steps=1)
        run.finish_phase("behind", {})
        before = run.metrics()
        assert run.newest("failed", "fresh", pytest.fail) == ("fresh", 0)
        assert run.metrics() == before
        run.log(phase="failed", env_steps=1)
        run.finish_phase("failed", {})
    again = {"phase": "failed", "env_steps": 1}
    assert run_dir.read_metrics(path) == [*ROWS, again, {"phase": "behind", "env_steps": 1}, again]


def test_a_line_that_found_no_room_is_not_there_once_there_is(path):
    with run_dir.resume(path) as run:
        size = (path / "metrics.jsonl").stat().st_size
        usual = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size + 20, usual[1]))
        try:
            with pytest.raises(RunError):
                run.rows.append({"phase": "ppo", "text": "x" * 50})
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, usual)
        run.log(phase="ppo", env_steps=4)
        run.finish_phase("more", {})
    assert run_dir.read_metrics(path) == [*ROWS, {"phase": "ppo", "env_steps": 4}]


@pytest.fixture
def path(tmp_path):
    """A run of four rows."""
    with run_dir.create(tmp_path / "run", RunConfig(), device="cpu", experiment="train") as run:
        for i in range(4):
            run.log(phase="ppo", env_steps=i, seconds=i / 2, env_steps_per_s=2.0)
        run.finish_phase("policy", {})
    return tmp_path / "run"


ROWS = [{"phase": "ppo", "env_steps": i} for i in range(4)]


def test_clocks_are_in_a_file_of_their_own_and_of_two_the_later_one_counts(path):
    assert run_dir.read_metrics(path) == ROWS
    row = {"phase": "ppo", "env_steps": 3, "seconds": 1.5, "env_steps_per_s": 2.0}
    assert run_dir.read_metrics(path, clocks=True)[3] == row
    assert json_lines.started(path)[:2] == "20"
    with run_dir.resume(path) as run:
        run.note_time(line=4, seconds=7.0)
    assert run_dir.read_metrics(path, clocks=True)[3]["seconds"] == 7.0


def test_a_damaged_line_is_refused_and_without_the_file_the_run_goes_on(path):
    file = path / json_lines.TIMES
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


def test_last_lines_that_were_cut_short_are_left_out_and_then_cut_off(path):
    times, metrics = path / json_lines.TIMES, path / "metrics.jsonl"
    times.write_bytes(times.read_bytes()[:-3])
    metrics.write_bytes(metrics.read_bytes() + b'{"phase": "lat')
    assert run_dir.read_metrics(path) == ROWS
    with run_dir.resume(path) as run:
        said = "the last line of {} was cut short, and is left out"
        assert run.said == [said.format(file) for file in (metrics, times)]
        run.log(phase="later")
    assert "seconds" not in run_dir.read_metrics(path, clocks=True)[3]
    assert run_dir.read_metrics(path) == [*ROWS, {"phase": "later"}]
