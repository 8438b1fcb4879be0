"""The first signal is a note, the second acts; handlers from before come back."""

import _thread
import contextlib
import gc
import importlib
import signal
import sys
import threading
import time
import weakref

import pytest

from gril_jax.cli import main
from gril_jax.cli.verbs import Verb
from gril_jax.errors import RunError
from gril_jax.runs import interrupt
from gril_jax.runs.interrupt import Interrupted, heard, noticed


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_signal_is_noted_and_nothing_is_raised(number):
    with noticed() as notice:
        assert notice.number is None
        signal.raise_signal(number)
        assert notice.number == number


def test_the_second_signal_acts_as_ever():
    with noticed() as notice:
        signal.raise_signal(signal.SIGTERM)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert notice.number == signal.SIGTERM


def test_what_is_ignored_stays_ignored():
    """As the end of the terminal under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with noticed() as notice:
            signal.raise_signal(signal.SIGHUP)
        assert notice.number is None
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_handlers_come_back_whatever_happened():
    before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
    with contextlib.suppress(RunError), noticed():
        assert signal.getsignal(signal.SIGINT) not in before
        raise RunError("the disk is gone")
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)] == before


def test_other_threads_leave_signals_alone():
    before, found = signal.getsignal(signal.SIGINT), []

    def work():
        with noticed() as notice:
            found.append((notice.number, signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [(None, before)]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_command_line_says_one_sentence_and_exits_as_shells_expect(
    monkeypatch, capsys, number, code
):
    def interrupted(_):
        raise Interrupted("it came, and the run is saved", number)

    verb = Verb("train", "", lambda args: lambda: interrupted(args))
    monkeypatch.setattr(main.verbs, "every", lambda: [verb])
    assert main.main(["train"]) == code
    assert capsys.readouterr().err == "gril: it came, and the run is saved.\n"


class _Last:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def _in_a_weak_reference():
    def callback(_):
        signal.raise_signal(signal.SIGINT)

    one = set()
    kept = weakref.ref(one, callback)
    del one
    assert kept() is None


def _in_the_collector():
    come = []

    def callback(phase, info):
        if not come:
            come.append(phase)
            signal.raise_signal(signal.SIGINT)

    gc.callbacks.append(callback)
    try:
        gc.collect()
    finally:
        gc.callbacks.remove(callback)


@pytest.mark.parametrize("lose", [_Last, _in_a_weak_reference, _in_the_collector])
def test_ctrl_c_is_heard_where_python_would_only_print_it(lose):
    hook, handler = sys.unraisablehook, signal.getsignal(signal.SIGINT)
    assert not _sleeps_through(lose)
    assert sys.unraisablehook is hook
    assert signal.getsignal(signal.SIGINT) is handler


@pytest.mark.parametrize(("longest", "through"), [(10.0, True), (0.0, False)])
def test_ctrl_c_waits_for_an_import_unless_that_takes_long(monkeypatch, tmp_path, longest, through):
    """Raised in one it can keep a lock for good, or come out as an ImportError or an abort."""
    (tmp_path / "slow_to_import.py").write_text(
        "import signal, sys, time\nsignal.raise_signal(signal.SIGINT)\ntime.sleep(0.1)\n"
        "sys.went_through = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "slow_to_import", raising=False)
    monkeypatch.setattr(sys, "went_through", False, raising=False)
    monkeypatch.setattr(interrupt, "_IMPORT_S", longest)
    assert not _sleeps_through(lambda: importlib.import_module("slow_to_import"))
    assert sys.went_through is through


def test_a_signal_that_comes_while_the_first_is_seen_to_is_not_lost(monkeypatch):
    start, sent = _thread.start_new_thread, []

    def start_with_a_signal(function, arguments):
        sent.append(signal.raise_signal(signal.SIGINT))
        return start(function, arguments)

    monkeypatch.setattr(_thread, "start_new_thread", start_with_a_signal)
    assert not _sleeps_through(_Last)
    assert len(sent) == 1


def test_a_signal_that_ended_no_wait_is_sent_again(monkeypatch):
    """As one that comes between the last look for signals and the wait itself."""
    send, sent = signal.pthread_kill, []

    def third_time(thread, number):
        sent.append(number)
        if len(sent) == 3:
            send(thread, number)

    monkeypatch.setattr(signal, "pthread_kill", third_time)
    assert not _sleeps_through(_Last)
    assert len(sent) == 3


def _sleeps_through(lose) -> bool:
    """True if Python goes on for thirty seconds after `lose` has lost a KeyboardInterrupt."""
    woke = []

    def work():
        lose()
        time.sleep(30)
        woke.append(True)

    with pytest.raises(KeyboardInterrupt), heard():
        work()
    return bool(woke)


def test_what_else_is_lost_goes_where_it_went_before(monkeypatch):
    class Broken:
        def __del__(self):
            raise RuntimeError("so it is")

    lost = []
    monkeypatch.setattr(sys, "unraisablehook", lambda what: lost.append(what.exc_type))
    with heard():
        Broken()
    assert lost == [RuntimeError]


def test_ctrl_c_interrupts_at_once_elsewhere_and_what_noticed_it_before_comes_first():
    with heard():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with noticed() as notice:
            signal.raise_signal(signal.SIGINT)
        assert notice.number == signal.SIGINT
