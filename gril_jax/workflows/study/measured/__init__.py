"""What a study measures of its rewards and policies, beside success while these are trained."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.workflows.build.demonstrations import Demonstrations

from ..saved import Plan
from . import audit, evaluation, files, profiles, separation
from .measure import TAU, Measure

# Measure to its numbers in a line; None: whatever its phase has for each seed.
NUMBERS: Mapping[str, Sequence[str] | None] = {
    "tau": ("tau",), "profiles": ("cycle",), "audit": None, "separation": None,
    "evaluation": evaluation.NUMBERS, "files": (),
}  # fmt: skip


def of_study(plan: Plan, gather: Callable[[RunConfig], Demonstrations], run: Path) -> list[Measure]:
    """The measures of a study's rewards, for the run in a folder."""
    make: dict[str, Callable[..., Measure]] = {
        "audit": audit.measure,
        "profiles": lambda: profiles.measure(gather),
        "separation": lambda: separation.measure(gather),
        "evaluation": lambda: evaluation.measure(gather),
        "files": lambda: files.measure(plan, run),
    }
    asked: dict[str, Any] = {k: dict(x) for k, x in plan.study.measure.items() if k in make}
    return [TAU, *(make[kind](**options) for kind, options in asked.items())]


def by_seed(kind: str, done: Mapping[str, Any]) -> list[dict[str, float]]:
    """The numbers of each seed in a finished phase; what was not finite is null there, and is left
    out."""
    wanted = NUMBERS[kind]
    lists = {k: x for k, x in done.items() if k != "seeds" and (wanted is None or k in wanted)}
    each = done.get("seeds") or [
        dict(zip(lists, values, strict=True)) for values in zip(*lists.values(), strict=True)
    ]
    return [{name: x for name, x in one.items() if x is not None} for one in each]
