"""One gradient step of soft actor-critic on one batch: temperature, critics and actor.

The critic's and the actor's loss are brax's; the temperature's is ours, because brax's has its
target entropy fixed. All three start from where the parameters stood before the step.

Source: Haarnoja et al., "Soft Actor-Critic Algorithms and Applications" (2018), with two critics.
Shapes use R for the transitions of a batch.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from brax.training.agents.sac import losses, networks
from brax.training.types import Transition
from jaxtyping import Array, Float, PRNGKeyArray

from gril_jax.config.encoder import PoolConfig
from gril_jax.config.policy import SACConfig

from .policy import fresh_weights

Number = Float[Array, ""] | float


class Hyper(NamedTuple):
    """Traced values: a sweep over them is a vmap and compiles once."""

    learning_rate: Number = SACConfig.learning_rate  # of actor and critics
    alpha_learning_rate: Number = 3e-4  # of the temperature's logarithm; 0 keeps it
    initial_alpha: Number = 1.0  # temperature, in units of scaled reward
    target_entropy: Number = -0.5  # nats for each number of an action
    discounting: Number = SACConfig.discounting
    soft_update: Number = 0.005  # share of the critics in their target, a step
    reward_scaling: Number = SACConfig.reward_scaling
    max_grad_norm: Number = 10.0  # of actor, critics and temperature each
    tau: Number = PoolConfig.tau  # activity threshold, in box diagonals
    decay_updates: Number = math.inf  # over which the share of own starts falls


class Params(NamedTuple):
    """Parameters that gradients update."""

    policy: Any
    critic: Any
    log_alpha: Float[Array, ""]


class Learned(NamedTuple):
    """State that gradient steps update."""

    params: Params
    target: Any  # the critics that bootstrap, which follow the others slowly
    moments: Any  # of Adam


def begin(nets: networks.SACNetworks, key: PRNGKeyArray, hyper: Hyper) -> Learned:
    """Initial weights. The key is consumed."""
    policy, critic = fresh_weights(key, nets.policy_network, nets.q_network)
    log_alpha = jnp.log(jnp.asarray(hyper.initial_alpha, jnp.float32))
    params = Params(policy, critic, log_alpha)
    target = jax.tree.map(jnp.copy, critic)  # a buffer cannot be donated twice
    return Learned(params, target, optax.scale_by_adam().init(params))


def gradient_step(
    nets: networks.SACNetworks,
    learned: Learned,
    normalizer: Any,
    batch: Transition,
    key: PRNGKeyArray,
    hyper: Hyper,
) -> tuple[Learned, dict[str, Float[Array, ""]]]:
    """One step of Adam for each of the three, then a soft update of the target critics.

    What the batch, leaves (R, ...), calls truncated is left out of the critic's loss. The key is
    consumed.

    Returns:
      What was learned, and the losses before the step.
    """
    params = learned.params
    keys = jax.random.split(key, 3)
    _, critic_loss, actor_loss = losses.make_losses(
        nets, hyper.reward_scaling, hyper.discounting, batch.action.shape[-1]
    )
    alpha = jnp.exp(params.log_alpha)
    of_actor, actor = jax.value_and_grad(actor_loss)(
        params.policy, normalizer, params.critic, alpha, batch, keys[0]
    )
    of_critic, critic = jax.value_and_grad(critic_loss)(
        params.critic, params.policy, normalizer, learned.target, alpha, batch, keys[1]
    )
    wanted = hyper.target_entropy * batch.action.shape[-1]
    excess = _entropy(nets, params.policy, normalizer, batch, keys[2]) - wanted
    # Eq. 18: its gradient lifts the temperature while the entropy is below its target.
    alpha_loss = lambda x: jnp.mean(jnp.exp(x) * excess)  # noqa: E731
    of_alpha, log_alpha = jax.value_and_grad(alpha_loss)(params.log_alpha)
    params, moments = _adam(params, learned.moments, Params(actor, critic, log_alpha), hyper)
    target = optax.incremental_update(params.critic, learned.target, hyper.soft_update)
    metrics = {"loss/actor": of_actor, "loss/critic": of_critic, "loss/alpha": of_alpha}
    return Learned(params, target, moments), metrics


def _entropy(nets, policy, normalizer, batch, key):
    """Minus the log density of one action sampled for each observation, (R,)."""
    actions = nets.parametric_action_distribution
    logits = nets.policy_network.apply(normalizer, policy, batch.observation)
    return -actions.log_prob(logits, actions.sample_no_postprocessing(logits, key))


def _adam(params: Params, moments, grads: Params, hyper: Hyper):
    """One step of Adam; actor, critics and temperature are each clipped by their own norm."""
    clip = optax.clip_by_global_norm(hyper.max_grad_norm)
    grads = Params(*(clip.update(x, clip.init(x))[0] for x in grads))
    steps, moments = optax.scale_by_adam().update(grads, moments)
    rates = Params(hyper.learning_rate, hyper.learning_rate, hyper.alpha_learning_rate)
    steps = Params(
        *(jax.tree.map(lambda x, r=r: -r * x, step) for r, step in zip(rates, steps, strict=True))
    )
    return optax.apply_updates(params, steps), moments
