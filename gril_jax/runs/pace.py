"""The length of a compiled call: a few seconds, so that a run answers signals and shows progress.

    pace = Pace()
    last = first + pace.moves(left)            # the first call makes one move
    ...
    pace.took(last - first, seconds)

A chunk of training may be cut into calls anywhere without changing a number.
"""

from . import hosts

CALL_S = 4.0  # a call's aim; also what a signal waits at most, unless a single move takes longer


class Pace:
    """The number of moves, such as updates, of a call, from the time that the last ones took."""

    def __init__(self) -> None:
        self._each_s: float | None = None

    def moves(self, left: int) -> int:
        """Moves of the next call, of so many that are left; the same in all processes."""
        fitting = 1 if self._each_s is None else int(CALL_S / max(self._each_s, 1e-9))
        (fewest,) = hosts.largest([-max(1, min(fitting, left))])
        return -fewest

    def took(self, moves: int, seconds: float) -> None:
        """Notes the last call."""
        self._each_s = seconds / moves
