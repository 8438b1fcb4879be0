"""Trainings that leave the finite numbers: which seeds, where, and what to lower.

    bad = noted(bad, {"loss": loss}, ["loss"], before=100)          # (S, updates) each
    said = {place: of_reward(config, one) for place, one in faults(bad, ["loss"]).items()}
    require_some(said, len(bad))

Seeds that train side by side do not touch each other: where one diverges, the others go on.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Int, Shaped

from gril_jax.config import RunConfig
from gril_jax.errors import RunError

_MOST = 1e30  # of a metric, as in what reads metrics.jsonl
WEIGHT, UNDONE = "a weight of the policy", "undone"


class DivergedError(RunError):
    """All trainings of a phase have diverged; their last finite checkpoint is kept."""


class Fault(NamedTuple):
    """The first number of a training that is not finite."""

    update: int  # counted from 1
    name: str


def unknown(seeds: int) -> Int[np.ndarray, "S 2"]:
    """The faults that `noted` begins with: none, since no seed has diverged."""
    return np.zeros((seeds, 2), np.int32)


def noted(
    bad: Any, metrics: Mapping[str, Shaped[np.ndarray, "S U"]], names: Sequence[str], before: int
) -> Int[np.ndarray, "S 2"]:
    """For each seed the first update, from 1, of which a metric was not finite, or above 1e30, and
    the place of its name; zeros where none was. It is part of a training's state.

    Args:
      bad: what is known from earlier updates, so many as `before` says.
      metrics: of U updates after these, finite or not.
      names: of all metrics.
    """
    found = np.array(bad)
    for place, name in enumerate(names):
        lost = ~(np.abs(np.asarray(metrics[name], float)) < _MOST)
        first = before + lost.argmax(axis=1) + 1
        earlier = (found[:, 0] == 0) | (first < found[:, 0])
        found[lost.any(axis=1) & earlier] = 0
        new = lost.any(axis=1) & (found[:, 0] == 0)
        found[new, 0], found[new, 1] = first[new], place
    return found


def faults(bad: Any, names: Sequence[str]) -> dict[int, Fault]:
    """The fault of each seed that has one, by its place."""
    found = enumerate(np.asarray(bad).tolist())
    return {place: Fault(update, names[what]) for place, (update, what) in found if update}


def are_finite(tree: Any) -> Bool[np.ndarray, "S"]:
    """True for each of S trainings whose numbers are all finite, of leaves (S, ...)."""
    leaves = [np.asarray(x) for x in jax.tree.leaves(jax.device_get(tree))]
    return np.all([np.isfinite(x).reshape(len(x), -1).all(axis=1) for x in leaves], axis=0)


def of_reward(config: RunConfig, fault: Fault | None) -> str:
    """A sentence, without its full stop, on an encoder that has diverged; without a fault it is the
    finished reward that is not finite."""
    where = "the learned reward is not finite"
    if fault is not None:
        what = fault.name.replace("_", " ")
        where = f"its {what} is not finite, or above {_MOST:g}, at gradient step {fault.update:,}"
    loss = config.loss
    weights = {
        "lambda": loss.lambda_,
        "perturbation-weight": loss.perturbation_weight,
        "intrusion-weight": loss.intrusion_weight,
    }
    most = max(weights, key=lambda name: weights[name])
    return (
        f"learning the reward diverged: {where}; lower --loss.{most}, which is {weights[most]:g}, "
        f"or raise --loss.temperature, which is {loss.temperature:g}"
    )


def of_policy(config: RunConfig, fault: Fault, steps: int) -> str:
    """The same on a policy; an update is of so many environment steps."""
    name = config.run.algorithm
    options, at = getattr(config, name), f"at env step {fault.update * steps:,}"
    if fault.name == UNDONE:
        return (
            f"learning the policy ended {at}: the task's state or its reward is not finite in most "
            "steps, which are undone; gril check-task looks at a task, gril audit at a reward"
        )
    lower = {
        f"--{name}.{field.replace('_', '-')}": getattr(options, field)
        for field in ("learning_rate", "reward_scaling", "entropy_cost")
        if hasattr(options, field)
    }
    named = ", ".join(f"{option} ({value:g})" for option, value in lower.items())
    what = f"{fault.name} is not finite, or above {_MOST:g}, {at}"
    return f"learning the policy diverged: {what}; lower one of {named}"


def require_some(sentences: Mapping[int, str], seeds: int) -> None:
    """Raises DivergedError, with the sentence of the first, if none of so many seeds is left."""
    if len(sentences) == seeds:
        others = f" (the other {seeds - 1} failed, too)" if seeds > 1 else ""
        raise DivergedError(f"{sentences[min(sentences)]}{others}")


def require_all(sentences: Mapping[int, str], first_seed: int) -> None:
    """Raises DivergedError if a seed has diverged, for whom it is no use that others have not."""
    if sentences:
        place = min(sentences)
        raise DivergedError(f"seed {first_seed + place} failed: {sentences[place]}")
