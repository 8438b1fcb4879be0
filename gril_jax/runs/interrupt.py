"""Handles SIGTERM, SIGHUP and Ctrl-C as requests to stop at a safe point."""

import _thread
import contextlib
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from types import CodeType, FrameType

from gril_jax.errors import GrilError

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # the last as a terminal is closed
_SOON = 0.01  # seconds
_IMPORT_S = 10.0  # that an import puts Ctrl-C off, at most


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
    if not _in_main():
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
    """Puts a KeyboardInterrupt off, a little, where it would be lost or do harm.

    Python only prints what is raised in a `__del__`, or in a callback of a weak reference or of the
    garbage collector, of which JAX has one that runs often while programs are traced. In an import
    it can keep a lock for good, become an ImportError, or abort a compiled module. An import that
    takes long is interrupted all the same.
    """
    before, over = sys.unraisablehook, threading.Event()
    usual = signal.getsignal(signal.SIGINT)

    def put_off(handler: Callable) -> None:
        until = time.monotonic() + _IMPORT_S

        def once(number: int, frame: FrameType | None) -> None:
            stack = {*_stack(frame)}
            if hook.__code__ in stack or (_imports(stack) and time.monotonic() < until):
                return
            signal.signal(signal.SIGINT, handler)
            (usual if handler is heed else handler)(number, frame)

        signal.signal(signal.SIGINT, once)
        # Not a `Thread`, whose `start` waits, on a busy machine until the signal comes: in here.
        _thread.start_new_thread(_repeat, (once, over))

    def heed(number: int, frame: FrameType | None) -> None:
        if _imports(_stack(frame)):
            put_off(heed)
        else:
            usual(number, frame)

    def hook(lost) -> None:
        handler = signal.getsignal(signal.SIGINT)
        if _in_main() and issubclass(lost.exc_type, KeyboardInterrupt) and callable(handler):
            put_off(handler)
        else:
            before(lost)

    ours = _in_main() and callable(usual)
    sys.unraisablehook = hook
    try:
        if ours:
            signal.signal(signal.SIGINT, heed)
        yield
    finally:
        over.set()
        if ours:
            signal.signal(signal.SIGINT, usual)
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


def _in_main() -> bool:
    """True in the main thread, the only one in which Python handles signals."""
    return threading.current_thread() is threading.main_thread()


def _stack(frame: FrameType | None) -> Iterator[CodeType]:
    """The code that is being run in a frame, and then that of its callers, the nearest first."""
    while frame is not None:
        yield frame.f_code
        frame = frame.f_back


def _imports(stack: Iterable[CodeType]) -> bool:
    """True if an import is in progress."""
    return any(code.co_filename == "<frozen importlib._bootstrap>" for code in stack)
