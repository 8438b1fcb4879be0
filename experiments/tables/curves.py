"""The policies of a run while they are trained, and what their curves come to.

Shapes use E for the evaluations of a policy while it is trained.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

LAST = ("env_steps", "success", "success_sampled", "success_ever", "score")  # of `at_the_end`


@dataclass(frozen=True)
class Curve:
    """The learning curve of one policy."""

    cell: int  # place of its row
    seed: int  # place of its seed
    tau: float | None  # of its reward; None where none is learned
    env_steps: Float[np.ndarray, "E"]
    seconds: Float[np.ndarray, "E"]  # of its program, whose other policies it was trained beside
    scores: Mapping[str, Float[np.ndarray, "E"]]  # as `sweeps.training` names them


def curves(
    finished: Mapping[str, Mapping[str, Any]], metrics: Sequence[Mapping[str, Any]]
) -> list[Curve]:
    """The policies that have finished, by row and seed.

    The phases are those of a run, with what they came to; in its lines of metrics.jsonl a score
    has one number for each policy of the program.
    """
    found = []
    for phase, done in finished.items():
        if not phase.startswith("policy-"):
            continue
        lines = [line for line in metrics if line["phase"] == phase]
        steps, seconds = (
            np.array([line[name] for line in lines], float) for name in ("env_steps", "seconds")
        )
        named = [name for name, value in lines[-1].items() if isinstance(value, list)]
        values = {name: np.array([line[name] for line in lines], float) for name in named}
        for i, ((cell, seed), tau) in enumerate(zip(done["rows"], done["taus"], strict=True)):
            own = {name: x[:, i] for name, x in values.items()}
            found.append(Curve(cell, seed, tau, steps, seconds, own))
    return sorted(found, key=lambda curve: (curve.cell, curve.seed))


def at_the_end(curve: Curve) -> dict[str, float]:
    """The scores of a policy's last evaluation, and `steps_80` to a success of 80 %."""
    success = curve.scores["success_sampled"]
    last = {name: float(values[-1]) for name, values in curve.scores.items()}
    steps = {"env_steps": float(curve.env_steps[-1])}
    return steps | last | {"steps_80": first_at(success, curve.env_steps, level=0.8)}


def first_at(success: Float[np.ndarray, "E"], at: Float[np.ndarray, "E"], *, level: float) -> float:
    """The first of `at` with this share of success, not interpolated; NaN if never reached."""
    reached = success >= level - 1e-6  # shares are float32
    return float(at[np.argmax(reached)]) if reached.any() else float("nan")


def in_last_tenth(env_steps: Float[np.ndarray, "E"]) -> Bool[np.ndarray, "E"]:
    """True for evaluations after nine tenths of the training; for the last one always."""
    return env_steps > 0.9 * env_steps[-1]
