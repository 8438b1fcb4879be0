"""How well rewards tell success from failure, as in the paper's Table II.

A reward is measured along successes that no encoder was trained on, and along failures, which train
none. Shapes use B for recordings and T for frames.
"""

import re
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gril_jax import reward
from gril_jax.demos.demo import Demo
from gril_jax.errors import DemoError
from gril_jax.metrics.separation import CONVENTIONS, cumulative, ratio, stage_order, success_auc
from gril_jax.workflows import held_out
from gril_jax.workflows.build import learners, setup

from .measures import Gather, Measure

# The separation ratio first in the convention that is compared with the paper's.
NUMBERS = (
    "rho_held", "rho_resampled", "rho_natural", "auc_final", "auc_held", "auc_resampled", "order",
    "preference_accuracy", "policy_ranking",
)  # fmt: skip

_LEAST = 2  # recordings of either outcome


class Separation(Measure):
    """The figures of each reward; refuses demonstrations that are too few for them.

    They are left out where there are no failures, unless the study measures nothing else."""

    name, words = "separation", "successes and failures apart"

    def __init__(self, gather: Gather, *, alone: bool = True) -> None:
        self.gather, self.alone = gather, alone

    def asked(self, config):
        """True, or False where they are left out; it may raise DemoError."""
        demos = self.gather(config)
        if not demos.names["failure"] and not self.alone:
            return False
        require_both(demos.demo_set.where, demos.names)
        return True

    def measure(self, programs, config, found):
        """`figures` of each reward, along held-out successes, then failures."""
        demos = self.gather(config)
        chosen = [demos.demo_set[x] for k in ("validation", "failure") for x in demos.names[k]]
        length = np.array([len(demo) for demo in chosen], np.int32)
        learner, hyper = learners.learner(config, demos), setup.pretrain_hyper(config)
        films = learner.films([demo.name for demo in chosen])

        def one(params):
            latents = learner.latents(params.encoder, films, hyper)
            values = reward.latent_reward(params, jnp.asarray(latents))
            return figures(np.asarray(values), length, chosen)

        each = [one(x.params) for x in found]
        return {name: [x[name] for x in each] for name in each[0]}


def require_both(folder: str, names: Mapping[str, Sequence[str]]) -> None:
    """Raises DemoError unless there are some recordings of either outcome to measure on."""
    for split, what in (("failure", "failures"), ("validation", "successes kept aside")):
        count = len(names[split])
        if count < _LEAST:
            raise DemoError(
                f"{folder} has {count} {what}, but rho needs at least {_LEAST}: "
                f"make more with demos.num_{'failures' if split == 'failure' else 'validation'}"
            )


def kind_of(entry: Demo) -> str:
    """The kind of failure in a name such as "051_one_shoe"; "success" if it is none."""
    if entry.outcome != "failure":
        return "success"
    found = re.fullmatch(r"\d+_(.+)", entry.name)
    return found[1].replace("_", " ") if found else "failure"


def stages_done(entry: Demo, num_frames: int) -> Int[np.ndarray, "T"]:
    """The number of stages finished by each frame; 0 where they are unknown."""
    ends = [frame for frame in (entry.stages or {}).values() if frame >= 0]
    done = np.arange(num_frames) >= np.array(ends, int)[:, None]
    return done.sum(axis=0, dtype=np.int32)


def figures(
    reward: Float[np.ndarray, "B T"], length: Int[np.ndarray, "B"], entries: Sequence[Demo]
) -> dict[str, float]:
    """Computes `NUMBERS`, and for each kind of failure `auc KIND` and `last KIND`.

    The length is that of each recording before padding. The order of stages is the mean over
    successes, NaN if their stages are not known. `last` is the mean reward of the last frames,
    `auc` compares the successes' with the kind's.
    """
    kinds = np.array([kind_of(entry) for entry in entries])
    success = kinds == "success"
    values = _compared(jnp.asarray(reward), jnp.asarray(length), jnp.asarray(success))
    ranks = jnp.array([held_out.rank(entry) for entry in entries], jnp.int32)
    values |= held_out.last_ranked(jnp.asarray(reward), jnp.asarray(length), ranks)
    found = {name: float(value) for name, value in values.items()}
    known = [i for i, e in enumerate(entries) if success[i] and e.stages]
    stages = np.stack([stages_done(entry, reward.shape[1]) for entry in entries])
    orders = np.asarray(_orders(jnp.asarray(reward), jnp.asarray(stages), jnp.asarray(length)))
    found["order"] = float(orders[known].mean()) if known else float("nan")
    last = reward[np.arange(len(reward)), length - 1]
    for kind in dict.fromkeys(kinds):
        found[f"last {kind}"] = float(last[kinds == kind].mean())
        if kind != "success":
            ones = jnp.asarray(np.r_[last[success], last[kinds == kind]])
            among = jnp.arange(len(ones)) < success.sum()
            found[f"auc {kind}"] = float(success_auc(ones, among))
    return found


@jax.jit
def _compared(reward, length, success: Bool[jax.Array, "B"]):
    found = {}
    for convention in CONVENTIONS:
        total = cumulative(reward, length, convention)
        found[f"rho_{convention}"] = ratio(total, success)
        # A sum of costs compares lengths if these differ, so there is none of natural lengths.
        if convention != "natural":
            found[f"auc_{convention}"] = success_auc(total, success)
    return found


_orders = jax.jit(jax.vmap(stage_order))
