"""Errors that a user can cause; each is one sentence with the remedy."""

from typing import Any


def printable(text: str) -> str:
    """The text on one line, with an escape for every letter that a terminal would obey or hide.

    >>> print(printable(f"red{chr(27)}[31m"))
    red\\x1b[31m
    """
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in " ".join(text.split("\n")))


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
