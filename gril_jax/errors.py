"""Errors that a user can cause; each is one sentence with the remedy."""

from typing import Any

_JOINERS = dict.fromkeys(map(ord, "\u200c\u200d"))  # with which Persian, Hindi and others spell


def is_printable(value: Any) -> bool:
    """True for text that a terminal and a page show as it is: no control characters, no line ends,
    no halves of letters.

    >>> is_printable("Küche 1"), is_printable("a\\n"), is_printable("\\ud800"), is_printable(1)
    (True, False, False, False)
    """
    return isinstance(value, str) and value.translate(_JOINERS).isprintable()


def printable(text: str) -> str:
    """The text with an escape for every letter that a terminal would obey or hide.

    >>> print(printable(f"red{chr(27)}[31m"))
    red\\x1b[31m
    """
    return "".join(c if is_printable(c) else repr(c)[1:-1] for c in text)


class GrilError(Exception):
    """Base of every error that a user can cause; its text is one sentence."""


class ConfigError(GrilError):
    """A configuration field or command-line option is unknown or out of range."""


class DemoError(GrilError):
    """A demonstration, video or boxes file is missing, damaged or not what it should be."""


class RunError(GrilError):
    """A run folder is missing, incomplete, or being written by another process."""


class ShapeError(GrilError, ValueError):
    """Arrays with incompatible shapes; the text names both."""


def require_at_least(options: Any, section: str, **lowest: int) -> None:
    """Raises ConfigError for the first of these fields that is below its lowest value."""
    for field, least in lowest.items():
        value = getattr(options, field)
        if value < least:
            raise ConfigError(f"{section}.{field} is {value}; it must be at least {least}.")
