"""times.jsonl: clocks are joined to their rows, and no line of it changes unnoticed."""

import json
import random

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


def test_clocks_are_in_a_file_of_their_own_and_readers_join_them(path):
    assert run_dir.read_metrics(path) == [{"phase": "ppo", "env_steps": i} for i in range(4)]
    row = {"phase": "ppo", "env_steps": 3, "seconds": 1.5, "env_steps_per_s": 2.0}
    assert run_dir.read_metrics(path, clocks=True)[3] == row
    assert times.started(path)[:2] == "20"


def test_of_two_times_of_a_row_the_later_one_counts(path):
    with run_dir.resume(path) as run:
        run.times.append(line=4, seconds=7.0)
    assert run_dir.read_metrics(path, clocks=True)[3]["seconds"] == 7.0


def test_no_flipped_bit_goes_unnoticed(path):
    file, draw = path / times.FILE, random.Random(0)
    good = file.read_bytes()
    for _ in range(100):
        data = bytearray(good)
        data[draw.randrange(len(good) - 1)] ^= 1 << draw.randrange(8)
        file.write_bytes(data)
        with pytest.raises(RunError, match=r"times\.jsonl"):
            run_dir.read_metrics(path, clocks=True)


@pytest.mark.parametrize("damage", ["swapped", "twice", "lost", "shorter", "emptied", "deleted"])
def test_lines_that_are_moved_or_lost_are_told(path, damage):
    file = path / times.FILE
    lines = file.read_bytes().splitlines(keepends=True)
    changed = {
        "swapped": [*lines[:2], lines[3], lines[2], *lines[4:]],
        "twice": [*lines[:2], lines[1], *lines[2:]],
        "lost": [*lines[:2], *lines[3:]],
        "shorter": lines[:-1],
    }.get(damage, [])
    file.write_bytes(b"".join(changed))
    if damage == "deleted":
        file.unlink()
    with pytest.raises(RunError, match=r"times\.jsonl"):
        run_dir.read_metrics(path, clocks=True)


@pytest.mark.parametrize("whole_lines", [0, 2])
def test_a_run_goes_on_without_times_that_are_damaged_and_says_so(path, whole_lines):
    file = path / times.FILE
    lines = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b"".join(lines[:whole_lines]) + b'{"line": 2}\n' * (whole_lines > 0))
    with run_dir.resume(path) as run:
        assert "times.jsonl is damaged" in run.said[0]
        run.log(phase="eval", seconds=3.0)
    *rows, last = run_dir.read_metrics(path, clocks=True)
    known = [0.0, None, None, None] if whole_lines else [None] * 4
    assert [row.get("seconds") for row in rows] == known
    assert last["seconds"] == 3.0
    assert json.loads(file.read_text().splitlines()[-1])["line"] == 5


def test_a_run_goes_on_without_times_of_its_last_rows_and_says_so(path):
    file = path / times.FILE
    file.write_bytes(b"".join(file.read_bytes().splitlines(keepends=True)[:3]))
    with run_dir.resume(path) as run:
        assert "it has no times of line 3 of metrics.jsonl" in run.said[0]
    found = run_dir.read_metrics(path, clocks=True)
    assert [row.get("seconds") for row in found] == [0.0, 0.5, None, None]


def test_a_line_that_was_cut_short_is_left_out_and_said(path):
    file = path / times.FILE
    file.write_bytes(file.read_bytes() + b'{"line": 5, "sec')
    assert len(run_dir.read_metrics(path, clocks=True)) == 4
    with run_dir.resume(path) as run:
        assert run.said == [f"the last line of {file} was cut short, and is left out"]
