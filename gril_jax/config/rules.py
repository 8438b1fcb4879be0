"""What a field of the configuration has to satisfy: metadata that `gril_jax.config.check` reads."""

from collections.abc import Callable
from typing import Any

__all__ = ["above", "at_least", "between", "rule"]


def rule(holds: Callable[[Any], bool], text: str) -> dict[str, Any]:
    """Field metadata: what a value has to satisfy, and the same in words after "must be"."""
    return {"holds": holds, "text": text}


def at_least(low: int | float) -> dict[str, Any]:
    """A number that is not below a limit."""
    return rule(lambda x: low <= x < float("inf"), f"finite and at least {low}")


def above(low: int | float) -> dict[str, Any]:
    """A number that is above a limit."""
    return rule(lambda x: low < x < float("inf"), f"finite and above {low}")


def between(low: int | float, high: int | float) -> dict[str, Any]:
    """A number from one limit to another, both included."""
    return rule(lambda x: low <= x <= high, f"from {low} to {high}")
