"""The progress line: compiling, rate, time left; plain lines away from a terminal."""

import io
import subprocess
import sys

import numpy as np
import pytest

from gril_jax.runs import progress as progress_line
from gril_jax.runs.progress import Progress, duration


class Clock:
    """Time that passes when it is told to."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(progress_line, "_clock", clock)
    return clock


@pytest.fixture
def stream():
    return io.StringIO()


@pytest.fixture
def progress(stream, clock):
    with Progress(stream=stream) as progress:
        yield progress


@pytest.mark.parametrize(
    ("total", "compiles", "updates", "line"),
    [  # updates are seconds that pass, and then the units done in all
        (2000, True, [(75, None)], "compiling ... 1:15"),
        (2000, True, [(75, 100)], "100/2,000 x (5%)"),
        (2000, True, [(1000, 100), (2, 300)], "300/2,000 x (15%), 100 x/s, 0:17 left"),
        (3, True, [(0, 0), (3, 1)], "1/3 x (33%), 0.33 x/s, 0:06 left"),
        (10, True, [(0, 5), (1, 10)], "10/10 x (100%), 5 x/s"),
        (0, True, [(0, 7)], "7 x"),
        (8, False, [(0, None)], "0/8 x (0%)"),
        (8, False, [(2, 1)], "1/8 x (12%), 0.5 x/s, 0:14 left"),
    ],
)
def test_a_line_says_what_is_done_how_fast_without_compilation_and_what_is_left(
    progress, clock, total, compiles, updates, line
):
    phase = progress.phase("a", total=total, unit="x", compiles=compiles)
    for seconds, done in updates:
        clock.now += seconds
        if done is not None:
            phase.update(done)
    assert phase.line() == f"a: {line}"


def test_metrics_are_those_of_the_last_update_and_a_rate_at_one_moment_is_finite(progress):
    phase = progress.phase("training", total=10, unit="updates")
    phase.update(1, loss=1.0, success=0)
    phase.update(1, success=np.float32(0.123456))
    assert phase.line() == "training: 1/10 updates (10%), success 0.1235"
    phase.update(2)
    assert 0 < phase.rate < float("inf")


def test_plain_lines_come_at_an_interval(progress, stream, clock):
    phase = progress.phase("training", total=100)
    for done in range(1, 51):
        clock.now += 1
        phase.update(done)
    lines = stream.getvalue().splitlines()
    assert lines[0] == "training: compiling ... 0:00"
    assert [line.split()[1] for line in lines[1:]] == [f"{n}/100" for n in (10, 20, 30, 40, 50)]


def test_the_last_line_of_a_phase_is_always_printed(stream, clock):
    with Progress(stream=stream) as progress:
        progress.phase("first", total=3).update(3)
        progress.phase("second", total=4).update(4)
    assert stream.getvalue().splitlines() == [
        "first: compiling ... 0:00",
        "first: 3/3 steps (100%)",
        "second: compiling ... 0:00",
        "second: 4/4 steps (100%)",
    ]


def test_a_line_is_not_printed_twice(progress, stream, clock):
    phase = progress.phase("training", total=3)
    clock.now += 20
    phase.update(3)
    progress.end_phase()
    assert [line.split()[1] for line in stream.getvalue().splitlines()] == ["compiling", "3/3"]


def test_a_terminal_gets_each_phase_once_at_its_end(clock):
    terminal = Terminal()
    with Progress(stream=terminal) as progress:
        phase = progress.phase("seed [red]", total=3)  # which is no markup
        for done in (1, 2, 3):
            clock.now += 60
            phase.update(done)
    assert "seed [red]: 3/3 steps (100%), 0.017 steps/s\n" in terminal.getvalue()


def test_a_notebook_gets_plain_lines(clock, monkeypatch):
    monkeypatch.setitem(sys.modules, "ipykernel", None)
    terminal = Terminal()
    with Progress(stream=terminal) as progress:
        progress.phase("training", total=3).update(3)
    lines = ["training: compiling ... 0:00", "training: 3/3 steps (100%)"]
    assert terminal.getvalue().splitlines() == lines


def test_it_can_be_switched_off(clock, capfd):
    with Progress(shown=False) as progress:
        phase = progress.phase("training", total=3)
        phase.update(3)
    assert capfd.readouterr() == ("", "")
    assert phase.line() == "training: 3/3 steps (100%)"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0:00"), (59.9, "0:59"), (60, "1:00"), (3599, "59:59"), (3600, "1:00:00")],
)
def test_durations_read_like_a_clock(seconds, text):
    assert duration(seconds) == text


def test_the_default_stream_is_stderr_and_nothing_heavy_is_imported():
    code = (
        "import sys\n"
        "from gril_jax.runs.progress import Progress\n"
        "with Progress() as progress: progress.phase('a', total=1).update(1)\n"
        "assert not {'jax', 'mujoco', 'numpy'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == "a: compiling ... 0:00\na: 1/1 steps (100%)\n"
