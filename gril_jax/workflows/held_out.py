"""Rewards along videos that they were not learned from, by the measures that the field compares by.

VOC and Kendall's tau say how a reward rises along held-out successes. Of a set that has failures,
the AUC, preference accuracy and policy ranking say how well the last reward tells them apart.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gril_jax import metrics, reward
from gril_jax.config import RunConfig
from gril_jax.demos.demo import Demo
from gril_jax.reward.latent_goal import RewardParams

from .build import learners, setup
from .build.demonstrations import Demonstrations

_TAILS = "_tails"  # behind the names of measures with resting ends
WORDS = {
    "voc_pearson": "Pearson's correlation of reward and time (VOC)",
    "voc_spearman": "Spearman's correlation of reward and time (VOC)",
    "reward_time_tau": "Kendall's tau of reward and time",
    "auc_final": "AUC of the last reward, successes against failures",
    "preference_accuracy": "pairs in which the better video ends with the higher reward",
    "policy_ranking": "tau-a of the last reward with the order of the videos",
}


def measured(
    config: RunConfig, demos: Demonstrations, rewards: Sequence[RewardParams]
) -> list[dict[str, float]]:
    """The figures of each reward, which are of the configuration's form; `WORDS` names them.

    Behind "_tails" are those with the resting ends of the videos, during which the last reward is
    held. `held_out` and `failures` are the numbers of videos.
    """
    names = demos.names["validation"] + demos.names["failure"]
    entries = [demos.demo_set[name] for name in names]
    learner, hyper = learners.learner(config, demos), setup.pretrain_hyper(config)
    films, held = learner.films(names), len(demos.names["validation"])
    known = (
        films.length,
        jnp.array([one.trimmed for one in entries], jnp.int32),
        jnp.array([rank(one) for one in entries], jnp.int32),
    )

    def one(params: RewardParams) -> dict[str, float]:
        along = reward.latent_reward(params, learner.latents(params.encoder, films, hyper))
        return {name: float(x) for name, x in figures(along, *known, held=held).items()}

    counts = {"held_out": held} | ({"failures": len(names) - held} if len(names) > held else {})
    return [one(params) | counts for params in rewards]


def rank(entry: Demo) -> int:
    """The place of a video in the order of `metrics.policy_ranking`.

    That of a failure is the number of stages that it finished, 0 if they are not known. Every
    success is above.
    """
    if entry.outcome != "failure":
        return np.iinfo(np.int32).max
    return sum(frame >= 0 for frame in (entry.stages or {}).values())


def figures(
    along: Float[Array, "B T"],
    length: Int[Array, "B"],
    trimmed: Int[Array, "B"],
    rank: Int[Array, "B"],
    *,
    held: int,
) -> dict[str, Float[Array, ""]]:
    """The measures of rewards along videos, of which the first `held` are successes.

    Args:
      along: the reward of each frame.
      length: frames before padding.
      trimmed: frames cut from the resting end.
      rank: of `rank`.
      held: how many videos VOC and tau are of; those behind are failures.
    """
    whole = jnp.arange(int(np.max(length[:held] + trimmed[:held])))
    ended = jnp.minimum(whole, length[:held, None] - 1)
    rested = jnp.take_along_axis(along[:held], ended, axis=1)
    found = _in_time(along[:held], length[:held])
    rising = _in_time(rested, length[:held] + trimmed[:held])
    found |= {f"{name}{_TAILS}": value for name, value in rising.items()}
    return found if len(along) == held else found | last_ranked(along, length, rank)


@jax.jit
def _in_time(along, length):
    return metrics.time_order(along, length)._asdict()


@jax.jit
def last_ranked(
    along: Float[Array, "B T"], length: Int[Array, "B"], rank: Int[Array, "B"]
) -> dict[str, Float[Array, ""]]:
    """The measures of the last reward of successes and failures; `figures` names the arguments."""
    last = jnp.take_along_axis(along, length[:, None] - 1, axis=1)[:, 0]
    return {
        "auc_final": metrics.success_auc(last, rank == jnp.iinfo(jnp.int32).max),
        "preference_accuracy": metrics.preference_accuracy(last, rank),
        "policy_ranking": metrics.policy_ranking(last, rank),
    }


def lines(found: Mapping[str, Any]) -> list[str]:
    """A line for each of the figures that are known, with its value with resting ends."""
    said = []
    for name, words in WORDS.items():
        if found.get(name) is None:
            continue
        tails = found.get(name + _TAILS)
        with_tails = "" if tails is None else f"; {tails:.3f} with resting ends"
        said.append(f"{name:19} {found[name]:6.3f}  {words}{with_tails}")
    count = f"{found.get('held_out')} held-out videos"
    if found.get("failures"):
        count += f" and {found['failures']} failures"
    return [f"rewards along {count}, which have no threshold:", *said] if said else []
