"""The stages that a policy's episodes come to, as the learned reward tells them."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float

from gril_jax.config import RunConfig
from gril_jax.reward.staircase import Staircase
from gril_jax.rl.starts import WithFrames


def stages(reward_params: Any) -> Staircase | None:
    """The stages among a policy reward's parameters; None if the reward has none."""
    params = reward_params.reward if isinstance(reward_params, WithFrames) else reward_params
    last = params[-1] if isinstance(params, tuple) and params else None
    return last if isinstance(last, Staircase) else None


def note(config: RunConfig, reward_params: Any) -> str | None:
    """A sentence if the demonstrations agree on another number of stages than there are
    sub-policies, else None."""
    found, asked = stages(reward_params), config.ppo.sub_policies
    if found is None or config.run.algorithm != "ppo" or asked in (1, int(found.count)):
        return None
    if int(found.count) == 1:
        return (
            "the demonstrations agree on no stages: one policy learns from one goal, and "
            f"{asked - 1} of {asked} sub-policies have nothing to do"
        )
    return (
        f"the demonstrations agree on {int(found.count)} stages, which {asked} sub-policies share "
        f"out: --ppo.sub-policies {int(found.count)} gives each stage its own"
    )


def finished(reward_params: Any, remembered: Float[Array, "E T K"]) -> list[float]:
    """The share of episodes that finished each stage; empty without stages."""
    found = stages(reward_params)
    if found is None:
        return []
    each = _index(found, np.asarray(remembered)[:, -1])
    return [float(np.mean(each > stage)) for stage in range(int(found.count))]


def in_words(reward_params: Any, remembered: Float[Array, "T K"]) -> list[str]:
    """The stage of an episode before its first step and after each, (T + 1); empty without
    stages."""
    found = stages(reward_params)
    if found is None:
        return []
    count = int(found.count)
    each = [0, *_index(found, np.asarray(remembered))]
    return [f"stage {n + 1} of {count}" if n < count else "all stages done" for n in each]


def _index(found: Staircase, remembered: Float[np.ndarray, "... K"]) -> np.ndarray:
    return np.round(remembered[..., -1] * int(found.count)).astype(int)
