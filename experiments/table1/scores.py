"""What the curves of Table I's policies come to: success at the end, and how soon it came.

Shapes use E for the evaluations of a policy while it is trained.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gril_jax.metrics.interquartile import interquartile_interval, interquartile_mean
from gril_jax.report.sweep_table import first_at

__all__ = [
    "LEVELS",
    "SCORES",
    "STARTS",
    "Curve",
    "Spread",
    "curves",
    "in_last_tenth",
    "spread",
    "summary",
]

STARTS = ("demo", "jitter", "layout")
LEVELS = (50, 80, 95)  # percent of success

# As `sweep_training.learn_policies` calls them: mean actions, then samples, from each start.
SCORES = tuple(
    f"{name}{start}{drawn}"
    for name in ("success", "score")
    for start in ("", *(f"_{start}" for start in STARTS[1:]))
    for drawn in ("", "_sampled")
)


@dataclass(frozen=True)
class Curve:
    """One policy while it is trained."""

    row: str
    seed: int
    env_steps: Float[np.ndarray, "E"]
    seconds: Float[np.ndarray, "E"]  # of its program, whose other policies it was trained beside
    scores: Mapping[str, Float[np.ndarray, "E"]]  # of `SCORES`


def curves(
    names: Sequence[str], rows: Sequence[Sequence[int]], lines: Sequence[Mapping[str, Any]]
) -> list[Curve]:
    """The policies of one program.

    Args:
      names: of the table's rows.
      rows: of each policy the place among the names, and the seed.
      lines: the program's lines of metrics.jsonl, whose scores have one number for each policy.
    """
    env_steps = np.array([line["env_steps"] for line in lines], float)
    seconds = np.array([line["seconds"] for line in lines], float)
    values = {name: np.array([line[name] for line in lines], float) for name in SCORES}
    return [
        Curve(names[cell], seed, env_steps, seconds, {n: x[:, i] for n, x in values.items()})
        for i, (cell, seed) in enumerate(rows)
    ]


def in_last_tenth(env_steps: Float[np.ndarray, "E"]) -> Bool[np.ndarray, "E"]:
    """Which evaluations came after nine tenths of the training; the last one always."""
    return env_steps > 0.9 * env_steps[-1]


def summary(curve: Curve) -> dict[str, float]:
    """The numbers of one policy: `SCORES` as means over the last tenth, and how soon it got there.

    `steps_80` and `seconds_80` are those to 80 % success with actions drawn, from Demo starts.
    """
    last = in_last_tenth(curve.env_steps)
    found = {name: float(values[last].mean()) for name, values in curve.scores.items()}
    found["env_steps"] = float(curve.env_steps[-1])
    success = curve.scores["success_sampled"]
    for level in LEVELS:
        found[f"steps_{level}"] = first_at(success, curve.env_steps, level=level / 100)
        found[f"seconds_{level}"] = first_at(success, curve.seconds, level=level / 100)
    return found


@dataclass(frozen=True)
class Spread:
    """A number over seeds."""

    mean: float
    middle: float  # the interquartile mean
    low: float  # of its 95 % bootstrap interval
    high: float


def spread(values: Float[np.ndarray, "seeds"]) -> Spread:
    """Mean, interquartile mean and its interval over at least one seed."""
    scores = jnp.asarray(values, jnp.float32)
    low, high = interquartile_interval(jax.random.key(0), scores)
    middle = interquartile_mean(scores)
    return Spread(float(np.mean(values)), float(middle), float(low), float(high))
