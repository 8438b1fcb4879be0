"""Proximal policy optimisation with rollout, reward, advantage and update in one pure function.

Networks, action distribution and observation statistics are brax's; the step that joins them is
ours, because brax's trainer can be neither jitted nor vmapped. Everything that the next step
depends on is in `TrainState`, so that saving it is enough to go on.

Shapes use B for environments and T for the control steps of one unroll.
"""

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from brax.training.acme import running_statistics
from brax.training.agents.ppo import losses, networks
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.config.encoder import PoolConfig
from gril_jax.config.policy import PPOConfig

from . import blocks, ppo_loss, rollout, set_networks
from .agent import Agent, Sizes
from .episodes import Environment
from .policy import (
    Policy,
    fresh_normalizer,
    fresh_weights,
    normalize,
    observed,
    of_stages,
)
from .rewards import AnyReward

Number = Float[Array, ""] | float


@dataclasses.dataclass(frozen=True)
class Static(Sizes):
    """Static choices, with PPO's own."""

    num_envs: int = PPOConfig.num_envs
    unroll_length: int = PPOConfig.unroll_length
    hidden: tuple[int, ...] = PPOConfig.hidden
    num_minibatches: int = PPOConfig.num_minibatches  # a divisor of `num_envs`
    num_epochs: int = PPOConfig.num_epochs
    by_object: bool = PPOConfig.by_object  # of tasks with `observation_rows`
    half: bool = False  # networks that read objects multiply in bfloat16
    sub_policies: int = PPOConfig.sub_policies  # with networks of their own, one for each stage
    noise_correlation: float = PPOConfig.noise_correlation  # share of variance held for an unroll


class Hyper(NamedTuple):
    """Traced values: a sweep over them is a vmap and compiles once."""

    learning_rate: Number = PPOConfig.learning_rate
    discounting: Number = PPOConfig.discounting
    gae_lambda: Number = PPOConfig.gae_lambda
    entropy_cost: Number = PPOConfig.entropy_cost
    clipping_epsilon: Number = PPOConfig.clipping_epsilon
    reward_scaling: Number = PPOConfig.reward_scaling
    max_grad_norm: Number = 1.0  # gradients whose global norm is larger are scaled down to it
    tau: Number = PoolConfig.tau  # activity threshold, in box diagonals
    decay_updates: Number = math.inf  # over which the two below are reached
    final_learning_rate_fraction: Number = PPOConfig.final_learning_rate_fraction
    final_entropy_fraction: Number = PPOConfig.final_entropy_fraction


class TrainState(NamedTuple):
    """Everything that training depends on."""

    params: losses.PPONetworkParams
    optimiser: Any
    normalizer: running_statistics.RunningStatisticsState
    envs: rollout.VectorState  # (B, ...)
    key: PRNGKeyArray
    updates: Int[Array, ""]
    replay: tuple[()] = ()  # learning is from the last unroll alone


class PPO(Agent):
    """PPO for one task and one reward; its functions are pure, for `jit`, `vmap` and `scan`.

        state = algorithm.init(key, hyper)
        state, metrics = algorithm.step(state, hyper, reward_params)

    The task, the reward function and `static` shape the compiled program. The key, the state,
    `hyper` and the reward's parameters are traced: a `vmap` sweeps them.
    """

    Static, Hyper = Static, Hyper

    def __init__(self, env: Environment, reward: AnyReward, static: Static):
        self.static = static
        self._passes = static.num_epochs, static.num_minibatches + 1  # keys of `learn`
        to_learn = math.prod(self._passes) + (static.noise_correlation > 0)
        super().__init__(env, reward, static, to_learn)
        one = networks.make_ppo_networks(
            self.observation_size, env.action_size, preprocess_observations_fn=normalize,
            policy_hidden_layer_sizes=static.hidden, value_hidden_layer_sizes=static.hidden,
        )  # fmt: skip
        if static.by_object:
            rows, names = env.observation_rows, getattr(env, "object_names", ())
            listed = sum(count * numbers for count, numbers in rows)
            own = jax.eval_shape(env.reset, jax.random.key(0)).obs.shape[0]
            one = set_networks.by_object(
                one, rows, self.observation_size, own - listed, static.hidden,
                robot=names.index("robot") if "robot" in names else 0,
                bits=static.observe_activity, gradient=static.observe_gradient, half=static.half,
            )  # fmt: skip
        self.networks = dataclasses.replace(
            one,
            policy_network=of_stages(one.policy_network, static.sub_policies),
            value_network=of_stages(one.value_network, static.sub_policies),
        )
        self._make_policy = networks.make_inference_fn(self.networks)

    def init(self, key: PRNGKeyArray, hyper: Hyper) -> TrainState:
        """Initial weights, and B environments at random times of their first episode.

        The key is consumed.
        """
        key, key_weights, envs = self._begin(key)
        both = self.networks.policy_network, self.networks.value_network
        params = losses.PPONetworkParams(*fresh_weights(key_weights, *both))
        moments, updates = _optimiser(hyper, 0.0).init(params), jnp.zeros((), jnp.int32)
        normalizer = fresh_normalizer(self.observation_size)
        return TrainState(params, moments, normalizer, envs, key, updates)

    def policy(self, state: TrainState) -> Policy:
        """The part of the state that acting needs."""
        return Policy(state.normalizer, state.params.policy)

    def collect(
        self,
        state: TrainState,
        key: PRNGKeyArray,
        hyper: Hyper,
        reward_params: Any,
        *,
        deterministic: Bool[Array, "B"],
    ) -> tuple[TrainState, rollout.Rollout]:
        """T control steps of every environment; `deterministic` ones play mean actions."""
        actions = self.networks.parametric_action_distribution
        network = functools.partial(self.networks.policy_network.apply, *self.policy(state))
        share, shape = self.static.noise_correlation, (self.num_envs, self.env.action_size)
        held = jax.random.normal(self._split(key)[-1][-1], shape) if share else 0.0

        def act(observation, key):
            logits = network(observation)
            raw = actions.sample_no_postprocessing(logits, key)
            if share:
                raw = _holding(actions.create_dist(logits), raw, held, share)
            mean, drawn = actions.mode(logits), actions.postprocess(raw)
            extras = {"raw_action": raw, "log_prob": actions.log_prob(logits, raw)}
            return jnp.where(deterministic[:, None], mean, drawn), extras

        return self._unroll(state, key, act, hyper, reward_params)

    def store(
        self, state: TrainState, steps: rollout.Rollout, *, wanted: Bool[Array, ""] | bool = True
    ) -> TrainState:
        """Returns the state unchanged: PPO stores nothing."""
        del steps, wanted
        return state

    def learn(
        self,
        state: TrainState,
        steps: rollout.Rollout,
        key: PRNGKeyArray,
        hyper: Hyper,
        reward_params: Any,
    ) -> tuple[TrainState, dict[str, Float[Array, ""]]]:
        """Runs `num_epochs` passes of `num_minibatches` updates over the collected data."""
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
            entropy_cost=hyper.entropy_cost * _left(hyper.final_entropy_fraction, progress),
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

        keys = self._split(key)[-1][: math.prod(self._passes)].reshape(self._passes)
        (params, moments), parts = jax.lax.scan(epoch, (state.params, state.optimiser), keys)
        metrics = {name: jnp.mean(value) for name, value in parts.items()}
        state = state._replace(
            params=params, optimiser=moments, normalizer=normalizer, updates=state.updates + 1
        )
        return state, rollout.summary(steps) | metrics

    def _batch(self, steps: rollout.Rollout, params, normalizer, hyper: Hyper) -> ppo_loss.Batch:
        """The collected data, with the value at time limits added to the reward.

        The value of the last observation before a reset at the time limit is added to that step's
        reward, and the step counts as an end. Steps undone by the non-finite guard are excluded
        from the loss.
        """
        result = steps.result
        timeouts = result.truncated * (1 - result.nonfinite)
        value = functools.partial(self.networks.value_network.apply, normalizer, params.value)
        if self.unroll_length <= self.env.episode_length:  # at most one time limit in each
            when = jnp.argmax(timeouts, axis=0)
            beyond = value(jax.vmap(lambda last, t: last[t], in_axes=(1, 0))(steps.last, when))
        else:
            beyond = value(steps.last)
        data = ppo_loss.Batch(
            observation=jnp.concatenate([steps.observation, steps.last[-1:]]),
            raw_action=steps.extras["raw_action"],
            log_prob=steps.extras["log_prob"],
            reward=result.reward + timeouts * hyper.discounting * beyond / hyper.reward_scaling,
            ended=(result.terminated + timeouts) * (1 - result.nonfinite),
            dropped=result.nonfinite,
        )
        return jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), data)


def _holding(dist: Any, raw: Float[Array, "B A"], held: Float[Array, "B A"], share: float):
    """Samples of the distribution whose noise is in part `held`, samples of the unit normal.

    Each is distributed as before, so that its probability is what it was. Those of an unroll are
    not independent of each other. The objective ignores that, as does PPO with coloured noise
    (Hollenstein et al., AAAI 2024).
    """
    return dist.loc + (1 - share) ** 0.5 * (raw - dist.loc) + share**0.5 * dist.scale * held


def _left(share: Float[Array, ""] | float, progress: Float[Array, ""] | float):
    """A factor that falls linearly from 1 to `share`."""
    return 1.0 - (1.0 - share) * progress


def _optimiser(hyper: Hyper, progress: Float[Array, ""] | float) -> optax.GradientTransformation:
    rate = hyper.learning_rate * _left(hyper.final_learning_rate_fraction, progress)
    return optax.chain(optax.clip_by_global_norm(hyper.max_grad_norm), optax.adam(rate))
