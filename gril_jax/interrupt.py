"""SIGTERM and Ctrl-C as a request to stop at the next good moment. JAX is not imported here."""

import contextlib
import gc
import signal
import threading
from collections.abc import Iterator
from types import FrameType

from .errors import GrilError

__all__ = ["Interrupted", "Notice", "heard", "noticed"]

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SOON = 0.01  # seconds


class Interrupted(GrilError):
    """A run was asked to stop, and has saved itself.

    Args:
      sentence: what was saved, and how to go on.
      number: of the signal.
    """

    def __init__(self, sentence: str, number: int):
        super().__init__(sentence)
        self.number = number

    @property
    def exit_code(self) -> int:
        """130 for SIGINT, 143 for SIGTERM, as shells have it."""
        return 128 + self.number


class Notice:
    """Which signal has come, if any."""

    number: int | None = None

    @property
    def name(self) -> str:
        """Such as "SIGTERM"."""
        return "" if self.number is None else signal.Signals(self.number).name


@contextlib.contextmanager
def noticed() -> Iterator[Notice]:
    """Notes the first SIGINT or SIGTERM; a second one acts as it would have without this.

    The handlers from before are back at the end. In any thread but the main one, where Python
    takes no handlers, signals act as ever.
    """
    notice = Notice()
    if threading.current_thread() is not threading.main_thread():
        yield notice
        return

    def note(number: int, _: object) -> None:
        notice.number = number
        restore()

    before = {number: signal.signal(number, note) for number in _SIGNALS}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)

    try:
        yield notice
    finally:
        restore()


@contextlib.contextmanager
def heard() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt where something hears it.

    Python only prints what is raised in a callback of its garbage collector, of which JAX has one
    that runs often while programs are traced, or in a `__del__`. There it is raised a moment later.
    The handlers from before are back at the end; threads but the main one take none.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    again: list[threading.Timer] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        if not _is_deaf(frame):
            raise KeyboardInterrupt
        main = threading.main_thread().ident
        again.append(threading.Timer(_SOON, signal.pthread_kill, (main, number)))
        again[-1].start()

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        for timer in again:
            timer.cancel()
        signal.signal(signal.SIGINT, signal.SIG_DFL if before is None else before)


def _is_deaf(frame: FrameType | None) -> bool:
    """Whether an exception from here gets no further than a callback or a `__del__`."""
    callbacks = [getattr(callback, "__code__", None) for callback in gc.callbacks]
    while frame is not None:
        if frame.f_code in callbacks or frame.f_code.co_name == "__del__":
            return True
        frame = frame.f_back
    return False
