"""The results of a sweep as tables: one line a cell, and one line a policy."""

import csv as csv_format
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax.metrics.interquartile import interquartile_interval, interquartile_mean

__all__ = ["Result", "csv", "first_at", "markdown", "median_reached", "results"]

# What is told of a policy, and how it is headed.
_COLUMNS = {
    "success": "success (mean actions)",
    "success_sampled": "success (samples)",
    "success_ever": "success at some moment",
    "score": "score",
}


@dataclass(frozen=True)
class Result:
    """One policy: its cell and seed, its reward's tau, and its scores after each chunk."""

    cell: int
    seed: int
    tau: float | None
    env_steps: Float[np.ndarray, "chunks"]
    scores: Mapping[str, Float[np.ndarray, "chunks"]]


def results(
    rows: Sequence[Sequence[int]],
    taus: Sequence[float | None],
    curve: Sequence[Mapping[str, Any]],
) -> list[Result]:
    """The policies of one program.

    Args:
      rows: cell and seed of each.
      taus: of their rewards; None where there is no learned one.
      curve: the program's lines of metrics.jsonl, whose values have one number for each row.
    """
    steps = np.array([line["env_steps"] for line in curve], float)
    values = {name: np.array([line[name] for line in curve], float) for name in _COLUMNS}
    return [
        Result(cell, seed, tau, steps, {name: x[:, i] for name, x in values.items()})
        for i, ((cell, seed), tau) in enumerate(zip(rows, taus, strict=True))
    ]


def first_at(
    success: Float[np.ndarray, "chunks"], at: Float[np.ndarray, "chunks"], *, level: float
) -> float:
    """Where the first evaluation at or above a level of success was, without interpolation.

    Args:
      success: shares from 0 to 1.
      at: env steps or seconds of each evaluation.
      level: a share.

    Returns:
      A value of `at`; NaN where the level was never reached.
    """
    reached = success >= level - 1e-6  # shares are float32
    return float(at[np.argmax(reached)]) if reached.any() else float("nan")


def median_reached(at: Float[np.ndarray, "seeds"], form: str) -> str:
    """The median of what `first_at` gave, in words: `4.8 (4 of 5)`, or `never (2 of 5)`.

    Seeds that never got there come last; of an even number the later of the middle two counts.
    """
    ordered = np.sort(np.nan_to_num(at, nan=np.inf))
    median = ordered[len(ordered) // 2]
    shown = f"{median:{form}}" if np.isfinite(median) else "never"
    return f"{shown} ({np.isfinite(at).sum()} of {len(at)})"


def markdown(names: Sequence[str], found: Sequence[Result]) -> str:
    """Per cell the mean and the interquartile mean over seeds, with its 95 % interval."""
    headings = ["", "seeds", *_COLUMNS.values(), "M env steps to 80 %", "tau"]
    lines = ["| " + " | ".join(headings) + " |", "|" + "---|" * len(headings)]
    for cell, name in enumerate(names):
        members = [result for result in found if result.cell == cell]
        if members:
            cells = [_spread([r.scores[column][-1] for r in members]) for column in _COLUMNS]
            taus = [r.tau for r in members if r.tau is not None]
            soon = median_reached(np.array([_to_80(r) / 1e6 for r in members]), ".2f")
            cells += [soon, f"{np.mean(taus):.3f}" if taus else ""]
            lines.append(f"| {name} | {len(members)} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "Mean; interquartile mean with its 95 % bootstrap interval over seeds. Steps are those at"
        " the first evaluation with a success of at least 80 % (samples), the median over seeds,"
        " of which those that never got there come last, and how many got there.",
    ]
    return "\n".join(lines)


def _spread(values: Sequence[float]) -> str:
    scores = jnp.asarray(values, jnp.float32)
    middle = float(interquartile_mean(scores))
    low, high = interquartile_interval(jax.random.key(0), scores)
    return f"{float(scores.mean()):.3f}; {middle:.3f} ({float(low):.3f} to {float(high):.3f})"


def _to_80(result: Result) -> float:
    return first_at(result.scores["success_sampled"], result.env_steps, level=0.8)


def csv(names: Sequence[str], found: Sequence[Result]) -> str:
    """One line a policy, in the order of cells and seeds."""
    file = io.StringIO()
    writer = csv_format.writer(file, lineterminator="\n")
    writer.writerow(["cell", "seed", "env_steps", *_COLUMNS, "steps_80", "tau"])
    for result in sorted(found, key=lambda r: (r.cell, r.seed)):
        last = [f"{values[-1]:.6g}" for values in result.scores.values()]
        tau = "" if result.tau is None else f"{result.tau:.6g}"
        steps, soon = int(result.env_steps[-1]), _to_80(result)
        soon_or_never = "" if np.isnan(soon) else int(soon)
        writer.writerow([names[result.cell], result.seed, steps, *last, soon_or_never, tau])
    return file.getvalue()
