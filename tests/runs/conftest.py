"""Signals are handled in these tests as in a terminal, wherever they run."""

import signal

import pytest


@pytest.fixture(autouse=True)
def _as_in_a_terminal():
    """A shell's background job ignores Ctrl-C from the start, and nohup the terminal's end."""
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
