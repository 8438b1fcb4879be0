"""The measures of a learned reward in Table II, from its traces along held-out recordings.

Successes that no encoder was trained on, and failures, which train none. Shapes use B for
recordings and T for frames.
"""

import re
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gril_jax.demos.schema import DemoEntry
from gril_jax.metrics.separation import CONVENTIONS, cumulative, ratio, stage_order, success_auc

# The separation ratio first in the convention that is compared with the paper's.
MEASURES = (
    "rho_held", "rho_resampled", "rho_natural", "auc_final", "auc_held", "auc_resampled", "order",
)  # fmt: skip


def kind_of(entry: DemoEntry) -> str:
    """The kind of failure in a name such as "051_one_shoe"; "success" if it is none."""
    if entry.outcome != "failure":
        return "success"
    found = re.fullmatch(r"\d+_(.+)", entry.name)
    return found[1].replace("_", " ") if found else "failure"


def stages_done(entry: DemoEntry, num_frames: int) -> Int[np.ndarray, "T"]:
    """The number of stages finished by each frame; 0 where they are unknown."""
    ends = [frame for frame in (entry.stages or {}).values() if frame >= 0]
    return np.sum([np.arange(num_frames) >= end for end in ends], axis=0, dtype=np.int32) * np.ones(
        num_frames, np.int32
    )


def measure(
    reward: Float[np.ndarray, "B T"], length: Int[np.ndarray, "B"], entries: Sequence[DemoEntry]
) -> dict[str, float]:
    """Computes `MEASURES`, and for each kind of failure `auc KIND` and `last KIND`.

    The length is that of each recording before padding.

    The order of stages is the mean over successes, NaN if their stages are not known. `last` is the
    mean reward of the last frames, `auc` compares the successes' with the kind's.
    """
    kinds = np.array([kind_of(entry) for entry in entries])
    success = kinds == "success"
    values = _compared(jnp.asarray(reward), jnp.asarray(length), jnp.asarray(success))
    found = {name: float(value) for name, value in values.items()}
    known = [i for i, e in enumerate(entries) if success[i] and e.stages]
    stages = np.stack([stages_done(entry, reward.shape[1]) for entry in entries])
    orders = np.asarray(_orders(jnp.asarray(reward), jnp.asarray(stages), jnp.asarray(length)))
    found["order"] = float(orders[known].mean()) if known else float("nan")
    last = reward[np.arange(len(reward)), length - 1]
    for kind in dict.fromkeys(kinds):
        found[f"last {kind}"] = float(last[kinds == kind].mean())
        if kind != "success":
            found[f"auc {kind}"] = _auc(last[success], last[kinds == kind])
    return found


@jax.jit
def _compared(reward, length, success: Bool[jax.Array, "B"]):
    last = jnp.take_along_axis(reward, length[:, None] - 1, axis=1)[:, 0]
    found = {"auc_final": success_auc(last, success)}
    for convention in CONVENTIONS:
        total = cumulative(reward, length, convention)
        found[f"rho_{convention}"] = ratio(total, success)
        # A sum of costs compares lengths if these differ, so there is none of natural lengths.
        if convention != "natural":
            found[f"auc_{convention}"] = success_auc(total, success)
    return found


_orders = jax.jit(jax.vmap(stage_order))


def _auc(one: Float[np.ndarray, "A"], other: Float[np.ndarray, "C"]) -> float:
    success = jnp.arange(len(one) + len(other)) < len(one)
    return float(success_auc(jnp.concatenate([jnp.asarray(one), jnp.asarray(other)]), success))
