"""PPO's loss on one minibatch: clipped policy ratio, squared error of the value, entropy.

The formulas are those of brax's `compute_ppo_loss`, which the tests hold it to. That one walks
through an unroll step by step in every minibatch, and reports a dozen figures. This one computes
advantages in log2 T steps. That suits GPUs, where each step of a loop launches kernels; on two CPU
cores both take as long.

Shapes use B for the lanes of the minibatch, T for the control steps of an unroll, O for the
observation and A for the action.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from brax.training.agents.ppo.losses import PPONetworkParams
from brax.training.agents.ppo.networks import PPONetworks
from jaxtyping import Array, Float, PRNGKeyArray

_VALUE_WEIGHT = 0.25  # of the squared error; brax's 0.5, and the half of a square


class Batch(NamedTuple):
    """Collected data, one row per environment."""

    observation: Float[Array, "B T+1 O"]  # before each step, and after the last
    raw_action: Float[Array, "B T A"]  # before it was squashed into its bounds
    log_prob: Float[Array, "B T"]  # of the action, when it was sampled
    reward: Float[Array, "B T"]
    ended: Float[Array, "B T"]  # 1 where nothing comes after the step
    dropped: Float[Array, "B T"]  # 1 where the step is not to be learned from


class Weights(NamedTuple):
    """Parameters of the loss; all may be traced."""

    discounting: Float[Array, ""] | float
    gae_lambda: Float[Array, ""] | float
    reward_scaling: Float[Array, ""] | float
    clipping_epsilon: Float[Array, ""] | float
    entropy_cost: Float[Array, ""] | float


def advantages(
    reward: Float[Array, "*B T"],
    value: Float[Array, "*B T+1"],
    ended: Float[Array, "*B T"],
    dropped: Float[Array, "*B T"],
    *,
    discounting: Float[Array, ""] | float,
    gae_lambda: Float[Array, ""] | float,
) -> tuple[Float[Array, "*B T"], Float[Array, "*B T"]]:
    """Generalised advantage estimation (Schulman et al. 2016): targets of the value, advantages.

    Let delta_t = r_t + discount v_(t+1) - v_t and c_t = discount lambda, both without what comes
    after an end. The target is v_t + x_t, where x_t = delta_t + c_t x_(t+1). That is a chain of
    affine maps, which `jax.lax.associative_scan` composes. The advantage looks one step further:
    r_t + discount target_(t+1) - v_t. A dropped step has delta_t = c_t = 0 and no advantage.

    `value` is of the observation before each step, and at last of the one after the last; of
    `ended` and `dropped` see `Batch`. A lambda of 0 looks one step ahead, 1 to the end.
    """
    kept, on = 1.0 - dropped, discounting * (1.0 - ended)
    value, last = value[..., :-1], value[..., -1:]

    def after(values):
        return jnp.concatenate([values[..., 1:], last], axis=-1)

    def compose(later, earlier):
        (slope, offset), (c, delta) = later, earlier
        return slope * c, delta + c * offset

    chain = kept * on * gae_lambda, kept * (reward + on * after(value) - value)
    _, excess = jax.lax.associative_scan(compose, chain, reverse=True, axis=reward.ndim - 1)
    target = value + excess
    return target, kept * (reward + on * after(target) - value)


def loss(
    params: PPONetworkParams,
    normalizer: Any,
    batch: Batch,
    key: PRNGKeyArray,
    networks: PPONetworks,
    weights: Weights,
) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
    """The loss of a minibatch, and metrics by name.

    These are its parts; `ratio_beyond`, the share of steps whose ratio was clipped; and
    `deviation`, the mean standard deviation of actions before they are squashed.

    The key samples the actions that estimate what squashing takes from the entropy.
    """
    actions = networks.parametric_action_distribution
    logits = networks.policy_network.apply(normalizer, params.policy, batch.observation)[:, :-1]
    value = networks.value_network.apply(normalizer, params.value, batch.observation)
    found = advantages(
        batch.reward * weights.reward_scaling, value, batch.ended, batch.dropped,
        discounting=weights.discounting, gae_lambda=weights.gae_lambda,
    )  # fmt: skip
    target, advantage = jax.lax.stop_gradient(found)
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    advantage = (1.0 - batch.dropped) * advantage  # or 0 would stand above the losses of others
    ratio = jnp.exp(actions.log_prob(logits, batch.raw_action) - batch.log_prob)
    clipped = jnp.clip(ratio, 1 - weights.clipping_epsilon, 1 + weights.clipping_epsilon)
    of_policy = -jnp.mean(jnp.minimum(ratio * advantage, clipped * advantage))
    of_value = _VALUE_WEIGHT * jnp.mean((target - value[:, :-1]) ** 2)
    entropy = jnp.mean(actions.entropy(logits, key))
    return of_policy + of_value - weights.entropy_cost * entropy, {
        "loss/policy": of_policy,
        "loss/value": of_value,
        "loss/entropy": -weights.entropy_cost * entropy,
        "ratio_beyond": jnp.mean((clipped != ratio).astype(jnp.float32)),
        "deviation": jnp.mean(actions.create_dist(logits).scale),
    }
