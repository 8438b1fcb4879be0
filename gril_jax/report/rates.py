"""Success rates in words: what each counts, and how sure it is.

A rate counts distinct starts. With deterministic actions a start has one episode, however often it
is played: a single start is "success" or "no success", and there is no rate. A field of
`results.json` that is no number, or a rate not from 0 to 1, is a `RunError`.
"""

import functools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from gril_jax.errors import RunError

from .data import number

UNKNOWN = "number of starts not recorded"
SURE = 1 - 1e-6  # a share of all: shares are float32
WHERE = "results.json"

_Z = 1.959963984540054  # 97.5% of a standard normal distribution lie below it


class Rate(NamedTuple):
    """A share of successes, and of what."""

    share: float  # from 0 to 1
    starts: int  # distinct ones
    episodes: int = 0  # 0 where unknown
    sampled: bool = False  # True for sampled actions
    variant: str = ""  # of the task, that draws the starts

    @property
    def single(self) -> bool:
        """True if nothing was repeated but one and the same episode."""
        return self.starts == 1 and not self.sampled

    @property
    def value(self) -> str:
        """The rate alone, in percent or in words."""
        if self.single:
            return "success" if self.share >= SURE else "no success"
        return f"{100 * self.share:.1f}%"

    @property
    def interval(self) -> tuple[float, float] | None:
        """Its 95% interval over starts; None where there are not several."""
        return wilson(self.share, self.starts) if self.starts > 1 else None

    @property
    def counted(self) -> str:
        """The starts that it counts, such as "256 Jitter starts"."""
        kind = f"{self.variant.capitalize()} start".lstrip()
        if self.starts > 1:
            return f"{self.starts} {kind}s"
        played = f"{self.episodes} sampled episodes" if self.episodes else "sampled episodes"
        return f"{played} from one {kind}" if self.sampled else f"one {kind}"

    @property
    def tally(self) -> str:
        """The number of them: "239 of 256 Jitter starts"; with one start what it counts, alone."""
        number = self.share * self.starts
        if self.interval is None:
            return self.counted
        whole = abs(number - round(number)) < 1e-3  # several samples from a start may differ
        return f"{round(number) if whole else self.value} of {self.counted}"

    def __str__(self) -> str:
        """The rate with what it counts and its interval, in one phrase."""
        if self.single:
            return f"{self.value} ({self.counted})"
        if self.interval is None:
            return f"{self.value} of {self.counted}"
        low, high = (100 * bound for bound in self.interval)
        return f"{self.value} of {self.counted} (95% interval {low:.1f}% to {high:.1f}%)"


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


# Fields of results.json that are rates, and what they are called.
_NAMES = {
    "success": "success with deterministic actions",
    "success_sampled": "success with sampled actions",
    "elsewhere_success": "success elsewhere, deterministic actions",
    "success_random": "success of a random policy",
    "success_ever": "success at some time",
}
_SAMPLED = ("success_sampled", "success_random")


def name(field: str) -> str:
    """The name of a field's rate."""
    return _NAMES[field]


def rates(results: Mapping[str, Any]) -> dict[str, Rate]:
    """The rates in `results.json` by their fields; those that are missing are left out."""
    get = functools.partial(number, results, where=WHERE)
    found = {}
    for field in _NAMES:
        share = get(field)
        if share is None:
            continue
        if not 0 <= share <= 1:
            raise RunError(f"{WHERE}: {field} is {share:g}, but must be from 0 to 1")
        part = "elsewhere_" if field.startswith("elsewhere_") else ""
        starts = get(f"{part}starts")
        if starts is None:
            raise RunError(f"{WHERE}: {part}starts is missing, which {field} counts")
        variant = str(results.get(f"{part}variant") or "")
        episodes = int(get("eval_episodes") or 0)
        found[field] = Rate(share, max(1, int(starts)), episodes, field in _SAMPLED, variant)
    return found


def own_start(results: Mapping[str, Any]) -> str | None:
    """The task's own start as "success" or "no success"; None with several or without a try."""
    solved = results.get("demo_solved")
    if solved is None:
        return None
    if not isinstance(solved, bool):
        raise RunError(f"{WHERE}: demo_solved must be true or false, not {solved!r:.40}")
    return "success" if solved else "no success"


def sentences(results: Mapping[str, Any]) -> list[str]:
    """A line for each rate, and one for the task's own start."""
    lines = [f"{_NAMES[field]}: {rate}" for field, rate in rates(results).items()]
    lines += [f"stages finished, as the learned reward has them: {x}" for x in _stages(results)]
    own = own_start(results)
    return lines + ([f"the task's own start: {own}"] if own else [])


def _stages(results: Mapping[str, Any]) -> list[str]:
    """A phrase of the shares of episodes that finished each stage, if there are stages."""
    shares = results.get("stages_finished") or []
    if not isinstance(shares, list) or not all(isinstance(x, float | int) for x in shares):
        raise RunError(f"{WHERE}: stages_finished must be numbers, not {shares!r:.40}")
    phrase = ", ".join(f"{i} in {100 * share:.1f}%" for i, share in enumerate(shares, 1))
    return [phrase] if phrase else []
