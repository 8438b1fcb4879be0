"""A progress line for the phases of a run: compiling, rate, time left, metrics.

On a terminal one line is redrawn in place; elsewhere, as in a notebook, a plain line is printed now
and then.
"""

import io
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

_INTERVAL_S = 10.0  # least time between two plain lines of a phase
_clock = time.monotonic


class Progress:
    """Shows one phase after another.

        with Progress() as progress:
            phase = progress.phase("pretraining", total=2000, unit="steps")
            phase.update(100, loss=0.31)

    The seconds of compilation count on by themselves: the line redraws in a thread of its own.
    Without a stream the lines go to stderr; with `shown=False` there are none.
    """

    def __init__(self, *, stream: io.TextIOBase | None = None, shown: bool = True):
        self._stream = (sys.stderr if stream is None else stream) if shown else io.StringIO()
        self._phase: Phase | None = None
        self._printed_s, self._printed = _clock(), ""
        self._live: Live | None = None
        # A notebook's stream may say that it is a terminal, for its colours, but redraws no line.
        if self._stream.isatty() and "ipykernel" not in sys.modules:
            console = Console(file=self._stream)
            self._live = Live(get_renderable=self._line, console=console, refresh_per_second=4)

    def __enter__(self) -> "Progress":
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end_phase()
        if self._live:
            self._live.stop()

    def phase(
        self,
        name: str,
        *,
        total: int,
        unit: str = "steps",
        compiles: bool = True,
        at_most: bool = False,
    ) -> "Phase":
        """Starts a phase, which ends the one before; `compiles` until its first `update`.

        With `at_most` it may end before its total."""
        self.end_phase()
        self._phase, self._printed = Phase(name, total, unit, self._report, at_most), ""
        if not compiles:
            self._phase.begin()
        self._print()
        return self._phase

    def steps(self, name: str, unit: str) -> Callable[[int, int], None]:
        """Shows a phase of which the steps are told later: (those done, all); from the first call
        on, so that it may never come."""
        own: list[Phase] = []

        def tell(done: int, total: int) -> None:
            if not own:
                own.append(self.phase(name, total=total, unit=unit, compiles=False))
            own[0].total = total
            own[0].update(done)

        return tell

    def end_phase(self) -> None:
        """Leaves the phase's last line on the screen."""
        if self._phase is None:
            return
        self._print()
        if self._live:
            self._live.console.print(self._line())
        self._phase = None

    def _report(self) -> None:
        if _clock() - self._printed_s >= _INTERVAL_S:
            self._print()

    def _print(self) -> None:
        if self._live is None and self._phase is not None:
            self._printed_s, line = _clock(), self._phase.line()
            if line != self._printed:  # the last line of a phase may stand there already
                print(line, file=self._stream, flush=True)
            self._printed = line

    def _line(self) -> Text:
        line = "" if self._phase is None else self._phase.line()
        return Text(line, overflow="ellipsis", no_wrap=True)


@dataclass
class Phase:
    """One phase: its progress, its speed, and its metrics."""

    name: str
    total: int  # units in all; 0 where that is unknown
    unit: str
    report: Callable[[], None]  # called after each update
    at_most: bool = False  # whether fewer may do

    def __post_init__(self):
        self._begin_s = _clock()
        self._first: tuple[float, int] | None = None  # when the first units were done: compiled
        self._now: tuple[float, int] = (self._begin_s, 0)
        self._metrics: Mapping[str, Any] = {}

    def begin(self) -> None:
        """Starts the count at zero, once compilation is done or if there is none."""
        self._first = self._now = (_clock(), 0)

    def update(self, done: int, **metrics: Any) -> None:
        """Sets the number of units done in all; metrics are shown until there are others."""
        self._now = (_clock(), done)
        self._first = self._first or self._now
        self._metrics = metrics or self._metrics
        self.report()

    @property
    def rate(self) -> float | None:
        """Units per second since the first update, so without compilation; None before two."""
        if self._first is None or self._now[1] <= self._first[1]:
            return None
        return (self._now[1] - self._first[1]) / max(self._now[0] - self._first[0], 1e-9)

    @property
    def left_s(self) -> float | None:
        """Seconds left at this rate, or None while there is no rate."""
        return None if self.rate is None else max(self.total - self._now[1], 0) / self.rate

    def line(self) -> str:
        """Such as `name: 400/2,000 steps (20%), 80 steps/s, 0:20 left, loss 0.31`."""
        if self._first is None:
            return f"{self.name}: compiling ... {duration(_clock() - self._begin_s)}"
        done, total, unit, rate = self._now[1], self.total, self.unit, self.rate
        share = f"/{total:,} {unit} ({100 * done // total}%)" if total else f" {unit}"
        if self.at_most:
            share = f" {unit} of at most {total:,}"
        parts = [f"{self.name}: {done:,}{share}"]
        if rate is not None:
            parts.append(f"{f'{rate:,.0f}' if rate >= 10 else f'{rate:.2g}'} {unit}/s")
            if done < total:
                parts.append(f"{'at most ' * self.at_most}{duration(self.left_s)} left")
        return ", ".join([*parts, *(f"{k} {float(v):.4g}" for k, v in self._metrics.items())])


def duration(seconds: int | float) -> str:
    """Formats a duration as `0:05`, `12:40` or `3:02:10`."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
