"""Checks of a task's options: each raises a ValueError of one sentence for the first wrong one."""

import difflib
from collections.abc import Sequence


def nearest(word: str, known: Sequence[str]) -> str:
    """A hint in brackets that names the known word most like this one, or nothing."""
    close = difflib.get_close_matches(word, known, n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def check_known(what: str, value: str, known: Sequence[str]) -> None:
    """Raises if a value is not one of the known ones."""
    if value not in known:
        listed = f"{', '.join(known)}{nearest(str(value), known)}"
        raise ValueError(f"{what} is {value!r}, but must be one of {listed}")


def check_counts(**options: int) -> None:
    """Raises if a count is below 1."""
    for what, count in options.items():
        if count < 1:
            raise ValueError(f"{what} is {count}, but must be at least 1")


def check_shares(**options: float) -> None:
    """Raises if a share is not between 0 and 1."""
    for what, share in options.items():
        if not 0 <= share <= 1:
            raise ValueError(f"{what} is {share}, but must be between 0 and 1")
