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


def test_a_phase_compiles_until_its_first_update(progress, clock):
    phase = progress.phase("pretraining", total=2000)
    clock.now += 75
    assert phase.line() == "pretraining: compiling ... 1:15"
    phase.update(100)
    assert phase.line() == "pretraining: 100/2,000 steps (5%)"


def test_the_rate_leaves_compilation_out(progress, clock):
    phase = progress.phase("pretraining", total=2000)
    clock.now += 1000
    phase.update(100)
    assert (phase.rate, phase.left_s) == (None, None)
    clock.now += 2
    phase.update(300)
    assert phase.rate == pytest.approx(100)
    assert phase.left_s == pytest.approx(17)
    assert phase.line() == "pretraining: 300/2,000 steps (15%), 100 steps/s, 0:17 left"


def test_metrics_are_those_of_the_last_update(progress, clock):
    phase = progress.phase("training", total=10, unit="updates")
    phase.update(1, loss=1.0, success=0)
    phase.update(1, success=np.float32(0.123456))
    assert phase.line() == "training: 1/10 updates (10%), success 0.1235"


def test_slow_rates_keep_two_digits(progress, clock):
    phase = progress.phase("evaluating", total=3, unit="episodes")
    phase.update(0)
    clock.now += 3
    phase.update(1)
    assert ", 0.33 episodes/s, 0:06 left" in phase.line()


def test_a_finished_phase_has_no_time_left(progress, clock):
    phase = progress.phase("training", total=10)
    phase.update(5)
    clock.now += 1
    phase.update(10)
    assert phase.left_s == 0
    assert phase.line() == "training: 10/10 steps (100%), 5 steps/s"


def test_updates_at_one_moment_give_a_finite_rate(progress):
    phase = progress.phase("training", total=10)
    phase.update(1)
    phase.update(2)
    assert 0 < phase.rate < float("inf")


def test_a_phase_of_unknown_length_has_no_share(progress):
    phase = progress.phase("reading", total=0, unit="files")
    phase.update(7)
    assert phase.line() == "reading: 7 files"


def test_a_phase_without_compilation_counts_from_its_start(progress, clock):
    phase = progress.phase("reading", total=8, unit="files", compiles=False)
    assert phase.line() == "reading: 0/8 files (0%)"
    clock.now += 2
    phase.update(1)
    assert phase.line() == "reading: 1/8 files (12%), 0.5 files/s, 0:14 left"


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


def test_an_error_inside_leaves_the_last_line_and_passes_on(stream, clock):
    def fail():
        with Progress(stream=stream) as progress:
            progress.phase("training", total=3).update(1)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert stream.getvalue().splitlines()[-1] == "training: 1/3 steps (33%)"


def test_a_terminal_gets_each_phase_once_at_its_end(clock):
    terminal = Terminal()
    with Progress(stream=terminal) as progress:
        phase = progress.phase("training", total=3)
        for done in (1, 2, 3):
            clock.now += 60
            phase.update(done)
    assert "training: 3/3 steps (100%), 0.017 steps/s\n" in terminal.getvalue()


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


def test_brackets_in_a_name_are_not_markup(clock):
    terminal = Terminal()
    with Progress(stream=terminal) as progress:
        progress.phase("seed [red]", total=1).update(1)
    assert "seed [red]: 1/1 steps" in terminal.getvalue()


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
