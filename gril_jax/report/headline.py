"""The verdict and the numbers at the top of a report, in words, and how sure they are.

A field of `results.json` that is no number, or a rate not from 0 to 1, is a `RunError`.
"""

import functools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from gril_jax.errors import RunError

from .data import number

_Z = 1.959963984540054  # 97.5% of a standard normal distribution lie below it
_WHERE = "results.json"
_SOLVED = 0.9  # success rate from which a run is said to have worked


class Tile(NamedTuple):
    """One number, its meaning, and a number to compare it with."""

    value: str
    label: str
    note: str = ""


class Verdict(NamedTuple):
    """One sentence on how it went."""

    grade: str  # "good", "fair", "bad", or "open" where there is nothing to judge yet
    text: str


def wilson(rate: float, count: int) -> tuple[float, float]:
    """Wilson's 95% interval of a success rate from 0 to 1 in `count` trials, at least 1: within 0
    and 1, and of some width even where all trials succeeded.

    >>> [round(x, 3) for x in wilson(0.5, 20)]
    [0.299, 0.701]
    """
    widening = _Z**2 / count
    middle = (rate + widening / 2) / (1 + widening)
    half = math.sqrt(rate * (1 - rate) * widening + widening**2 / 4) / (1 + widening)
    return max(0.0, middle - half), min(1.0, middle + half)


def verdict(results: Mapping[str, Any]) -> Verdict:
    """A sentence on whether the run worked, judged by the success of its policy."""
    if not results:
        return Verdict("open", "The run has not finished, so it has no results yet.")
    rate, random, tau, episodes = (
        number(results, field, _WHERE)
        for field in ("success", "success_random", "tau", "eval_episodes")
    )
    if rate is None:
        known = "" if tau is None else f": Kendall's tau on held-out demonstrations is {tau:.3f}"
        return Verdict("open", f"A reward was learned{known}.")
    count = int(episodes or 0)
    share = f"{round(rate * count)} of {count}" if count else f"{100 * rate:.1f}% of the"
    found = f"{share} evaluation episodes succeed"
    against = "" if random is None else f"; a random policy: {100 * random:.0f}%"
    if rate >= _SOLVED:
        return Verdict("good", f"It worked: {found}{against}.")
    chance = wilson(random or 0.0, count)[1] if count else random or 0.0
    if (wilson(rate, count)[0] if count else rate) > chance:
        return Verdict("fair", f"It works in part: {found}{against}.")
    return Verdict("bad", f"It did not work: {found}{against}.")


def headline(results: Mapping[str, Any]) -> list[Tile]:
    """Tiles of the numbers in `results.json`; missing numbers have none."""
    get = functools.partial(number, results, where=_WHERE)
    episodes = int(get("eval_episodes") or 0)
    rates = {
        "success": "success of the trained policy",
        "success_sampled": "success with sampled actions",
        "success_random": "success of a random policy",
    }
    known = {field: rate for field in rates if (rate := get(field)) is not None}
    tiles = [_rate_tile(field, rate, episodes, rates[field]) for field, rate in known.items()]
    others = (
        (get("tau"), ".3f", "Kendall's tau of the alignment",
         "on demonstrations kept aside; 1 is perfect, 0 is chance"),
        (get("reward_time_tau"), ".3f", "Kendall's tau of reward and time",
         "1 if the reward never falls along a demonstration"),
        (get("env_steps"), ",.0f", "environment steps", ""),
        (get("trimmed_frames"), ",.0f", "frames trimmed",
         "cut from ends of videos in which nothing moves"),
    )  # fmt: skip
    return tiles + [
        Tile(format(value, shape), label, note)
        for value, shape, label, note in others
        if value is not None
    ]


def _rate_tile(field: str, rate: float, episodes: int, label: str) -> Tile:
    if not 0 <= rate <= 1:
        raise RunError(f"{_WHERE}: {field} is {rate:g}, but must be from 0 to 1")
    note = ""
    if episodes >= 1:
        low, high = (100 * bound for bound in wilson(rate, episodes))
        note = f"{round(rate * episodes)} of {episodes} episodes; "
        note += f"95% Wilson interval {low:.1f}% to {high:.1f}%"
    return Tile(f"{100 * rate:.1f}%", label, note)


def in_words(seconds: int | float) -> str:
    """A duration in plain words.

    >>> in_words(4.26), in_words(251), in_words(7500)
    ('4.3 s', '4 min 11 s', '2 h 5 min')
    """
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
