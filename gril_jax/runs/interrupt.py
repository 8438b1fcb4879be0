"""Handles SIGTERM, SIGHUP and Ctrl-C as requests to stop at a safe point."""

import _thread
import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

from gril_jax.errors import GrilError

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # the last as a terminal is closed
_SOON = 0.01  # seconds


class Interrupted(GrilError):
    """Raised when a run was asked to stop by signal `number` and has saved itself."""

    def __init__(self, sentence: str, number: int):
        super().__init__(sentence)
        self.exit_code = 128 + number  # 130 for SIGINT, as in shells


class Notice:
    """The signal that has come, if any."""

    number: int | None = None


@contextlib.contextmanager
def noticed() -> Iterator[Notice]:
    """Notes the first signal of these; a second one acts as if this handler were absent.

    One that the process ignores, as under nohup, stays ignored. In any thread but the main one,
    where Python takes no handlers, signals act as ever.
    """
    notice = Notice()
    if threading.current_thread() is not threading.main_thread():
        yield notice
        return

    def note(number: int, _: object) -> None:
        notice.number = number
        restore()

    heeded = [n for n in _SIGNALS if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in heeded}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    try:
        yield notice
    finally:
        restore()


@contextlib.contextmanager
def heard() -> Iterator[None]:
    """Raises a KeyboardInterrupt again that Python would only print, a little later.

    It only prints what is raised in a `__del__`, or in a callback of a weak reference or of the
    garbage collector, of which JAX has one that runs often while programs are traced.
    """
    before, over = sys.unraisablehook, threading.Event()

    def hook(lost) -> None:
        here = threading.current_thread() is threading.main_thread()
        handler = signal.getsignal(signal.SIGINT)
        if not (here and issubclass(lost.exc_type, KeyboardInterrupt) and callable(handler)):
            before(lost)
            return

        def once(number: int, frame: FrameType | None) -> None:
            if not _within(hook, frame):  # where it would be lost again
                signal.signal(number, handler)
                handler(number, frame)

        signal.signal(signal.SIGINT, once)
        # Not a `Thread`, whose `start` waits, on a busy machine until the signal comes: in here.
        _thread.start_new_thread(_repeat, (once, over))

    sys.unraisablehook = hook
    try:
        yield
    finally:
        over.set()
        if sys.unraisablehook is hook:  # else it is part of what has replaced it
            sys.unraisablehook = before


def _repeat(handler: Callable, over: threading.Event) -> None:
    """Sends the main thread SIGINT until `handler` is no longer what handles it.

    One signal may be too few: one that comes as the main thread is about to wait for something,
    a sleep say, is acted on only after the wait.
    """
    main = threading.main_thread().ident
    while not over.wait(_SOON) and signal.getsignal(signal.SIGINT) is handler:
        signal.pthread_kill(main, signal.SIGINT)


def _within(function: Callable, frame: FrameType | None) -> bool:
    """True if `function` is being run in `frame`, or has called what is."""
    while frame is not None and frame.f_code is not function.__code__:
        frame = frame.f_back
    return frame is not None
