"""Proximal policy optimisation with rollout, reward, advantage and update in one pure function.

Networks, action distribution and observation statistics are brax's; the step that joins them is
ours, because brax's trainer can be neither jitted nor vmapped. Everything that the next step
depends on is in `TrainState`, so that saving it is enough to go on.

Shapes use B for environments and T for the control steps of one unroll.
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from brax.training.acme import running_statistics
from brax.training.agents.ppo import losses, networks
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from gril_jax.config.encoder import PoolConfig
from gril_jax.config.policy import PPOConfig

from . import blocks, ppo_loss, rollout, training
from .episodes import Episodes, Lane
from .policy import Policy, fresh_normalizer, fresh_weights, normalize, observed
from .rewards import AnyReward

__all__ = ["PPO", "Hyper", "Static", "TrainState"]

Number = Float[Array, ""] | float


@dataclasses.dataclass(frozen=True)
class Static:
    """What shapes the compiled program."""

    num_envs: int = PPOConfig.num_envs
    unroll_length: int = PPOConfig.unroll_length
    num_minibatches: int = PPOConfig.num_minibatches
    num_epochs: int = PPOConfig.num_epochs
    hidden: tuple[int, ...] = PPOConfig.hidden
    observe_activity: bool = True
    window: int = PoolConfig.window  # of the activity memory, frames
    smoothing: int = PoolConfig.smoothing  # of centres, frames, before that
    noise: float | None = PoolConfig.noise  # of centres, world units


class Hyper(NamedTuple):
    """What may vary within one program: a sweep over it is a vmap."""

    learning_rate: Number = PPOConfig.learning_rate
    discounting: Number = PPOConfig.discounting
    gae_lambda: Number = PPOConfig.gae_lambda
    entropy_cost: Number = PPOConfig.entropy_cost
    clipping_epsilon: Number = PPOConfig.clipping_epsilon
    reward_scaling: Number = PPOConfig.reward_scaling
    max_grad_norm: Number = PPOConfig.max_grad_norm
    tau: Number = PoolConfig.tau  # activity threshold, in box diagonals
    decay_updates: Number = 1.0  # over which the two below are reached
    learning_rate_left: Number = (
        PPOConfig.learning_rate_left
    )  # share of the learning rate, at the end
    entropy_left: Number = PPOConfig.entropy_left  # share of the entropy cost, at the end


class TrainState(NamedTuple):
    """Everything that training depends on."""

    params: losses.PPONetworkParams
    optimiser: Any
    normalizer: running_statistics.RunningStatisticsState
    fleet: rollout.Fleet  # (B, ...)
    key: PRNGKeyArray
    updates: Int[Array, ""]
    replay: tuple[()] = ()  # learning is from the last unroll alone


class PPO:
    """The algorithm for one environment and one reward; its functions are pure.

    Args:
      env: the task.
      reward: what to maximise; its parameters are an argument of `step`.
      static: sizes; `num_minibatches` divides `num_envs`.
    """

    def __init__(self, env: Any, reward: AnyReward, static: Static):
        self.env, self.static = env, static
        self.num_envs, self.unroll_length = static.num_envs, static.unroll_length
        self.episodes = Episodes.of(
            env, reward, observe_activity=static.observe_activity, window=static.window,
            smoothing=static.smoothing, noise=static.noise,
        )  # fmt: skip
        self.observation_size = self.episodes.observation_size
        self.networks = networks.make_ppo_networks(
            self.observation_size,
            env.action_size,
            preprocess_observations_fn=normalize,
            policy_hidden_layer_sizes=static.hidden,
            value_hidden_layer_sizes=static.hidden,
        )
        self._make_policy = networks.make_inference_fn(self.networks)
        self._renewals = rollout.renewals(static.num_envs, static.unroll_length, env.episode_length)
        self.keys_to_collect = self._renewals + static.unroll_length
        self.keys_to_learn = static.num_epochs * (static.num_minibatches + 1)

    # ---------------------------------------------------------------- what a caller uses

    def init(self, key: PRNGKeyArray, hyper: Hyper) -> TrainState:
        """Fresh weights, and environments at random times of their first episode."""
        keys = jax.random.split(key, 3 + 2 * self.num_envs)
        key, key_weights, key_time = keys[0], keys[1], keys[2]
        both = self.networks.policy_network, self.networks.value_network
        params = losses.PPONetworkParams(*fresh_weights(key_weights, *both))
        begun = rollout.init(self.episodes, keys[3:])
        return TrainState(
            params=params,
            optimiser=_optimiser(hyper, 0.0).init(params),
            normalizer=fresh_normalizer(self.observation_size),
            fleet=rollout.scatter(begun, key_time, self.env.episode_length),
            key=key,
            updates=jnp.zeros((), jnp.int32),
        )

    def step(
        self, state: TrainState, hyper: Hyper, reward_params: Any
    ) -> tuple[TrainState, dict[str, Float[Array, ""]]]:
        """One unroll of every environment, then `num_epochs` passes over its data."""
        return training.step(self, state, hyper, reward_params)

    def policy(self, state: TrainState) -> Policy:
        """What of the state is needed to act."""
        return Policy(state.normalizer, state.params.policy)

    def act(
        self, policy: Policy, lane: Lane, key: PRNGKeyArray, *, deterministic: bool = False
    ) -> Float[Array, "A"]:
        """The policy's action in [-1, 1] for one lane."""
        act = self._make_policy(tuple(policy), deterministic=deterministic)
        return act(self.episodes.observe(lane), key)[0]

    # ---------------------------------------------------------------- the two halves of a step

    def collect(
        self,
        state: TrainState,
        keys: Key[Array, "K"],
        hyper: Hyper,
        reward_params: Any,
        *,
        deterministic: Bool[Array, "B"],
    ) -> tuple[TrainState, rollout.Steps]:
        """T control steps of every environment; `deterministic` ones play mean actions.

        `keys` are as many as `keys_to_collect`: first those of new starts, then one a step.
        """
        actions = self.networks.parametric_action_distribution
        network = functools.partial(self.networks.policy_network.apply, *self.policy(state))

        def act(observation, key):
            logits = network(observation)
            raw = actions.sample_no_postprocessing(logits, key)
            mean, drawn = actions.mode(logits), actions.postprocess(raw)
            extras = {"raw_action": raw, "log_prob": actions.log_prob(logits, raw)}
            return jnp.where(deterministic[:, None], mean, drawn), extras

        renewed = rollout.renew(self.episodes, state.fleet, keys[: self._renewals])
        moved, steps = rollout.unroll(
            self.episodes, reward_params, renewed, act, keys[self._renewals :], tau=hyper.tau
        )
        return state._replace(fleet=moved), steps

    def store(
        self, state: TrainState, steps: rollout.Steps, *, wanted: Bool[Array, ""] | bool = True
    ) -> TrainState:
        """The state itself: nothing is kept for later."""
        del steps, wanted
        return state

    def learn(
        self,
        state: TrainState,
        steps: rollout.Steps,
        keys: Key[Array, "K"],
        hyper: Hyper,
        reward_params: Any,
    ) -> tuple[TrainState, dict[str, Float[Array, ""]]]:
        """`num_epochs` passes of `num_minibatches` updates over what was collected."""
        del reward_params
        normalizer = observed(state.normalizer, steps.observation)
        data = self._batch(steps, state.params, normalizer, hyper)
        progress = jnp.clip(state.updates / hyper.decay_updates, 0.0, 1.0)
        optimiser = _optimiser(hyper, progress)
        weights = ppo_loss.Weights(
            discounting=hyper.discounting,
            gae_lambda=hyper.gae_lambda,
            reward_scaling=hyper.reward_scaling,
            clipping_epsilon=hyper.clipping_epsilon,
            entropy_cost=hyper.entropy_cost * _left(hyper.entropy_left, progress),
        )

        def minibatch(carry, batch_and_key):
            params, moments = carry
            batch, key_loss = batch_and_key
            grads, parts = jax.grad(ppo_loss.loss, has_aux=True)(
                params, normalizer, batch, key_loss, self.networks, weights
            )
            updates, moments = optimiser.update(grads, moments)
            return (optax.apply_updates(params, updates), moments), parts

        minibatches = self.static.num_minibatches

        def epoch(carry, keys):
            batches = blocks.minibatches(data, keys[-1], minibatches)
            return jax.lax.scan(minibatch, carry, (batches, keys[:-1]))

        keys = keys.reshape(self.static.num_epochs, minibatches + 1)
        (params, moments), parts = jax.lax.scan(epoch, (state.params, state.optimiser), keys)
        metrics = {name: jnp.mean(value) for name, value in parts.items()}
        state = state._replace(
            params=params, optimiser=moments, normalizer=normalizer, updates=state.updates + 1
        )
        return state, rollout.summary(steps) | metrics

    def _batch(self, steps: rollout.Steps, params, normalizer, hyper: Hyper) -> ppo_loss.Batch:
        """All that was collected, with a time limit's value in its reward.

        The value of the last observation before a reset at the time limit is added to that step's
        reward, and the step counts as an end. Steps that a failure took back are dropped.
        """
        moment = steps.moment
        timeouts = moment.truncated * (1 - moment.nonfinite)
        value = functools.partial(self.networks.value_network.apply, normalizer, params.value)
        if self.unroll_length <= self.env.episode_length:  # at most one time limit a lane
            when = jnp.argmax(timeouts, axis=0)
            beyond = value(jax.vmap(lambda last, t: last[t], in_axes=(1, 0))(steps.last, when))
        else:
            beyond = value(steps.last)
        data = ppo_loss.Batch(
            observation=jnp.concatenate([steps.observation, steps.last[-1:]]),
            raw_action=steps.extras["raw_action"],
            log_prob=steps.extras["log_prob"],
            reward=moment.reward + timeouts * hyper.discounting * beyond / hyper.reward_scaling,
            ended=(moment.terminated + timeouts) * (1 - moment.nonfinite),
            dropped=moment.nonfinite,
        )
        return jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), data)


def _left(share: Float[Array, ""] | float, progress: Float[Array, ""] | float):
    """A factor that falls linearly from 1 to `share`."""
    return 1.0 - (1.0 - share) * progress


def _optimiser(hyper: Hyper, progress: Float[Array, ""] | float) -> optax.GradientTransformation:
    rate = hyper.learning_rate * _left(hyper.learning_rate_left, progress)
    return optax.chain(optax.clip_by_global_norm(hyper.max_grad_norm), optax.adam(rate))
