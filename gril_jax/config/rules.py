"""Rules for the fields of configurations and of verbs: metadata that says what a value must be."""

from collections.abc import Callable, Mapping
from typing import Any

from gril_jax.errors import ConfigError


def rule(holds: Callable[[Any], bool], text: str) -> dict[str, Any]:
    """Field metadata: a predicate on the value, and its description after "must be"."""
    return {"holds": holds, "text": text}


def at_least(low: int | float) -> dict[str, Any]:
    """Rule for a number that is not below a limit."""
    return rule(lambda x: low <= x < float("inf"), f"finite and at least {low}")


def above(low: int | float) -> dict[str, Any]:
    """Rule for a number that is above a limit."""
    return rule(lambda x: low < x < float("inf"), f"finite and above {low}")


def between(low: int | float, high: int | float) -> dict[str, Any]:
    """Rule for a number from one limit to another, both included."""
    return rule(lambda x: low <= x <= high, f"from {low} to {high}")


def count() -> dict[str, Any]:
    """Rule for a whole number of at least 1."""
    return rule(lambda x: x >= 1, "at least 1")


def optional(metadata: dict[str, Any]) -> dict[str, Any]:
    """The same rule for a value that may also be None."""
    return rule(lambda x: x is None or metadata["holds"](x), metadata["text"])


def require(name: str, value: Any, metadata: Mapping[str, Any]) -> None:
    """Raises ConfigError if a value breaks the rule of its field."""
    if metadata and not metadata["holds"](value):
        shown = list(value) if isinstance(value, tuple) else value
        raise ConfigError(f"{name} is {shown!r}, but must be {metadata['text']}")
