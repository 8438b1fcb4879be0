"""The bounds that a sound reward keeps in its audit, and an audit's outcome in a few words."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ..data import number

OUTBID = "outbid_share"  # beside what is asked; no reward outbids nothing at the edge of success
_WHERE = "results.json, audit"


class Asked(NamedTuple):
    """The bound of one measure."""

    words: str  # what it is
    bound: str  # what it must be, in words
    holds: Callable[[float], bool]  # whether a value is so; NaN never is
    short: str


ASKED = {
    "order_accuracy": Asked(
        "pairs of states in their true order", "at least 0.97", lambda x: x >= 0.97, "order"
    ),
    "hack_gap": Asked(
        "worst success less best state without progress", "above 0", lambda x: x > 0, "hack gap"
    ),
    "touch_share": Asked(
        "share of the range for touching everything", "at most 0.05", lambda x: x <= 0.05, "touch"
    ),
    "push_share": Asked(
        "share of the range for targets at a wrong place", "at most 0.7", lambda x: x <= 0.7, "push"
    ),
}


def faults(numbers: Mapping[str, float]) -> list[str]:
    """The measures that are not as asked; one that is not known is a fault."""
    return [name for name, one in ASKED.items() if not one.holds(numbers.get(name, float("nan")))]


def outbid(numbers: Mapping[str, float]) -> str:
    """A sentence on successes that are paid too little."""
    return (
        "Of all successes, those at the edge of what the task counts included, "
        f"{numbers[OUTBID]:.0%} are paid no more than the best state without progress."
    )


def kept(results: Mapping[str, Any]) -> dict[str, Any]:
    """The part of `audit.json` that a run keeps in its results."""
    return {name: results[name] for name in (*ASKED, OUTBID)} | {"settings": results["settings"]}


def of_run(results: Mapping[str, Any]) -> dict[str, float] | None:
    """The numbers of a run's own audit, in its `results.json`; None without one."""
    found = results.get("audit")
    if not isinstance(found, Mapping):
        return None
    known = {name: number(found, name, _WHERE) for name in (*ASKED, OUTBID)}
    return {name: float("nan") if value is None else value for name, value in known.items()}


def sentence(results: Mapping[str, Any]) -> str:
    """A run's audit in one line."""
    numbers = of_run(results)
    if numbers is None:
        return "audit: none; gril audit RUN searches for states that the reward overestimates"
    return f"audit: the reward is {'not ' * bool(faults(numbers))}sound ({in_short(numbers)})"


def in_short(numbers: Mapping[str, float]) -> str:
    """The measures, such as "order 0.999, hack gap 0.53, touch 0.01, push 0.47, outbid 0.17";
    those that are not as asked say so."""
    bad = faults(numbers)
    parts = [
        f"{one.short} {numbers[name]:.{3 if name == 'order_accuracy' else 2}f}"
        + f", not {one.bound}" * (name in bad)
        for name, one in ASKED.items()
    ]
    return "; ".join([*parts, f"outbid {numbers[OUTBID]:.2f}"])
