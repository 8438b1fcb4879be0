"""Networks of sub-policies: each stage of a task has weights of its own.

The learned reward knows the stage that an episode has come to, from the latents alone
(`gril_jax.reward.staircase`), and the policy sees it: the last number of its
observation is the share of the stages that are finished. The network of the present stage answers,
for actions and for values. So a sub-policy begins where its predecessor has finished its stage,
learns from its own stage alone, and still explores when the ones before it have settled. At
hand-over, a stage bootstraps from its successor's value estimate, so that it learns to end where
the successor can go on. T-STAR (Lee et al., CoRL 2021) keeps sub-policies together by a loss on
where a stage ends, after training them one by one; here all learn at once, in one compiled step.
"""

from typing import Any

import jax
import jax.numpy as jnp
from brax.training.networks import FeedForwardNetwork
from jaxtyping import Array, Float, Int, PRNGKeyArray

_ROUNDING = 1e-4  # of a share in float32


def of_stages(network: FeedForwardNetwork, count: int) -> FeedForwardNetwork:
    """A network with weights for each of so many stages, leaves (count, ...); `network` if it is
    one.

    Its `apply` takes the network's arguments, statistics of observations, weights and observations
    (..., O), and answers as the network of each observation's stage does.
    """
    if count == 1:
        return network

    def init(key: PRNGKeyArray) -> Any:
        return jax.vmap(network.init)(jax.random.split(key, count))

    def apply(normalizer: Any, params: Any, observation: Float[Array, "*batch O"]) -> Array:
        each = jax.vmap(network.apply, (None, 0, None))(normalizer, params, observation)
        chosen = jax.nn.one_hot(stage(observation, count), count, axis=0, dtype=bool)
        chosen = chosen.reshape(*chosen.shape, *(1,) * (each.ndim - chosen.ndim))
        return jnp.sum(jnp.where(chosen, each, 0), axis=0)

    return FeedForwardNetwork(init, apply)


def stage(observation: Float[Array, "*batch O"], count: int) -> Int[Array, "*batch"]:
    """The sub-policy that acts, from 0: each has as many stages as it can be shared out, with as
    many stages as sub-policies one each; the last goes on when all are finished."""
    begun = jnp.floor(observation[..., -1] * count + _ROUNDING).astype(jnp.int32)
    return jnp.clip(begun, 0, count - 1)
