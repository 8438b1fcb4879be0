"""Proximal policy optimisation with rollout, reward, advantage and update in one pure function.

Networks, loss, advantages, action distribution and observation statistics are brax's; the step
that joins them is ours, because brax's trainer can be neither jitted nor vmapped. Everything that
the next step depends on is in `TrainState`, so that saving it is enough to go on.

Shapes use B for environments and T for the control steps of one unroll.
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from brax.training.acme import running_statistics, specs
from brax.training.agents.ppo import losses, networks
from brax.training.types import Transition
from jaxtyping import Array, Float, Int, PRNGKeyArray

from . import env_loop
from .rewards import RewardFn

__all__ = ["PPO", "Hyper", "Policy", "Static", "TrainState"]

# In standard deviations. An input that was constant so far, such as the speed of a block that
# nobody has touched, has one of 1e-6: without a limit its first change enters the networks as a
# million.
_MAX_OBSERVATION = 10.0


@dataclasses.dataclass(frozen=True)
class Static:
    """What shapes the compiled program."""

    num_envs: int = 64
    unroll_length: int = 30
    num_minibatches: int = 4
    num_epochs: int = 4
    hidden: tuple[int, ...] = (64, 64)
    observe_activity: bool = True
    window: int = 40  # of the activity memory, frames
    smoothing: int = 1  # of centres, frames, before that
    noise: float | None = None  # of centres, world units


class Hyper(NamedTuple):
    """What may vary within one program: a sweep over it is a vmap."""

    learning_rate: Float[Array, ""] | float = 3e-4
    discounting: Float[Array, ""] | float = 0.99
    gae_lambda: Float[Array, ""] | float = 0.95
    entropy_cost: Float[Array, ""] | float = 1e-2
    clipping_epsilon: Float[Array, ""] | float = 0.2
    reward_scaling: Float[Array, ""] | float = 1.0
    max_grad_norm: Float[Array, ""] | float = 1.0
    tau: Float[Array, ""] | float = 0.005  # activity threshold, in box diagonals


class Policy(NamedTuple):
    """Enough to act: observation statistics and the policy network's weights."""

    normalizer: running_statistics.RunningStatisticsState
    params: Any


class TrainState(NamedTuple):
    """Everything that training depends on."""

    params: losses.PPONetworkParams
    optimiser: Any
    normalizer: running_statistics.RunningStatisticsState
    lanes: env_loop.Lane  # (B, ...)
    key: PRNGKeyArray
    updates: Int[Array, ""]


def _optimiser(hyper: Hyper) -> optax.GradientTransformation:
    return optax.chain(
        optax.clip_by_global_norm(hyper.max_grad_norm), optax.adam(hyper.learning_rate)
    )


class PPO:
    """The algorithm for one environment and one reward; `init`, `step` and `act` are pure.

    Args:
      env: the task.
      reward_fn: what to maximise; its parameters are an argument of `step`.
      static: sizes; `num_minibatches` divides `num_envs`.
    """

    def __init__(self, env: Any, reward_fn: RewardFn, static: Static):
        self.env, self.reward_fn, self.static = env, reward_fn, static
        lane = jax.eval_shape(self.begin, jax.random.key(0))
        self.observation_size = jax.eval_shape(self._observe, lane).shape[0]
        self.networks = networks.make_ppo_networks(
            self.observation_size,
            env.action_size,
            preprocess_observations_fn=functools.partial(
                running_statistics.normalize, max_abs_value=_MAX_OBSERVATION
            ),
            policy_hidden_layer_sizes=static.hidden,
            value_hidden_layer_sizes=static.hidden,
        )
        self._make_policy = networks.make_inference_fn(self.networks)

    # ---------------------------------------------------------------- the three functions

    def init(self, key: PRNGKeyArray, hyper: Hyper) -> TrainState:
        """Fresh weights and environments, these at random times of their first episode.

        Were all episodes to begin together, every batch would hold one phase of the task only.
        """
        key, key_policy, key_value, key_lanes, key_time = jax.random.split(key, 5)
        params = losses.PPONetworkParams(
            policy=self.networks.policy_network.init(key_policy),
            value=self.networks.value_network.init(key_value),
        )
        lanes = self._fresh_lanes(key_lanes)
        time = jax.random.randint(
            key_time, (self.static.num_envs,), 0, self.env.episode_length, jnp.int32
        )
        return TrainState(
            params=params,
            optimiser=_optimiser(hyper).init(params),
            normalizer=running_statistics.init_state(
                specs.Array((self.observation_size,), jnp.dtype("float32"))
            ),
            lanes=lanes._replace(time=time),
            key=key,
            updates=jnp.zeros((), jnp.int32),
        )

    def step(
        self, state: TrainState, hyper: Hyper, reward_params: Any
    ) -> tuple[TrainState, dict[str, Float[Array, ""]]]:
        """One unroll of every environment, then `num_epochs` passes over its data."""
        key, key_unroll, key_update = jax.random.split(state.key, 3)
        lanes, data, metrics = self._unroll(state, key_unroll, hyper, reward_params)
        normalizer = running_statistics.update(state.normalizer, data.observation)

        loss = functools.partial(
            losses.compute_ppo_loss,
            ppo_network=self.networks,
            entropy_cost=hyper.entropy_cost,
            discounting=hyper.discounting,
            reward_scaling=hyper.reward_scaling,
            gae_lambda=hyper.gae_lambda,
            clipping_epsilon=hyper.clipping_epsilon,
        )

        def minibatch(carry, batch):
            params, optimiser, key = carry
            key, key_loss = jax.random.split(key)
            grads, aux = jax.grad(loss, has_aux=True)(params, normalizer, batch, key_loss)
            updates, optimiser = _optimiser(hyper).update(grads, optimiser)
            return (optax.apply_updates(params, updates), optimiser, key), aux

        def epoch(carry, key_epoch):
            order = jax.random.permutation(key_epoch, self.static.num_envs)
            batches = jax.tree.map(
                lambda x: x[order].reshape(self.static.num_minibatches, -1, *x.shape[1:]), data
            )
            return jax.lax.scan(minibatch, carry, batches)

        key_epochs, key_loss = jax.random.split(key_update)
        (params, optimiser, _), aux = jax.lax.scan(
            epoch,
            (state.params, state.optimiser, key_loss),
            jax.random.split(key_epochs, self.static.num_epochs),
        )
        metrics |= {f"loss/{name}": jnp.mean(value) for name, value in aux.items()}
        state = TrainState(params, optimiser, normalizer, lanes, key, state.updates + 1)
        return state, metrics

    def act(
        self,
        policy: Policy,
        lane: env_loop.Lane,
        key: PRNGKeyArray,
        *,
        deterministic: bool = False,
    ) -> Float[Array, "A"]:
        """The policy's action in [-1, 1] for one lane."""
        act = self._make_policy((policy.normalizer, policy.params), deterministic=deterministic)
        return act(self._observe(lane), key)[0]

    def begin(self, key: PRNGKeyArray) -> env_loop.Lane:
        """A lane at the start of an episode. The key is consumed."""
        static = self.static
        return env_loop.begin(self.env, key, window=static.window, smoothing=static.smoothing)

    def advance(
        self,
        reward_params: Any,
        lane: env_loop.Lane,
        action: Float[Array, "A"],
        *,
        tau: Float[Array, ""] | float,
    ) -> tuple[env_loop.Lane, env_loop.Moment]:
        """One control step of one lane, with its reward."""
        rule = {"tau": tau, "noise": self.static.noise}
        return env_loop.advance(self.env, self.reward_fn, reward_params, lane, action, **rule)

    # ---------------------------------------------------------------- parts

    def _observe(self, lane: env_loop.Lane) -> Float[Array, "O"]:
        return env_loop.observe(lane, activity_bits=self.static.observe_activity)

    def _fresh_lanes(self, key: PRNGKeyArray) -> env_loop.Lane:
        return jax.vmap(self.begin)(jax.random.split(key, self.static.num_envs))

    def _unroll(self, state: TrainState, key: PRNGKeyArray, hyper: Hyper, reward_params: Any):
        """T control steps of every environment: lanes, transitions (B, T, ...) and metrics.

        A lane that ends takes up one fresh start that was drawn for it before the unroll: real
        variety at a T-th of the cost of drawing at every step.
        """
        key_fresh, key_act = jax.random.split(key)
        fresh = self._fresh_lanes(key_fresh)
        policy = self._make_policy((state.normalizer, state.params.policy))
        advance = functools.partial(self.advance, reward_params, tau=hyper.tau)

        def move(lanes, key_step):
            observation = jax.vmap(self._observe)(lanes)
            action, extras = policy(observation, key_step)
            lanes, moment = jax.vmap(advance)(lanes, action)
            last = jax.vmap(self._observe)(lanes)
            transition = Transition(
                observation=observation,
                action=action,
                reward=moment.reward,
                discount=1.0 - moment.terminated,
                next_observation=last,
                extras={
                    "policy_extras": extras,
                    "state_extras": {"truncation": moment.truncated},
                },
            )
            ended = moment.terminated + moment.truncated > 0
            lanes = jax.vmap(env_loop.reset_where)(ended, fresh, lanes)
            return lanes, (transition, moment, ended)

        steps = jax.random.split(key_act, self.static.unroll_length)
        lanes, (data, moments, ended) = jax.lax.scan(move, state.lanes, steps)
        data = jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), data)
        return lanes, data, _episode_metrics(moments, ended)


def _episode_metrics(moments: env_loop.Moment, ended) -> dict[str, Float[Array, ""]]:
    """Means over the unroll; success and score over the episodes that ended in it.

    Only episodes from the task's own starts count for success and score; `episodes` is how many.
    """
    own = ended * (1.0 - moments.metrics.get("varied", jnp.zeros_like(moments.reward)))
    episodes = jnp.sum(own)
    metrics = {
        name: jnp.sum(own * value) / jnp.maximum(episodes, 1.0)
        for name, value in moments.metrics.items()
        if name != "varied"
    }
    return metrics | {
        "episodes": episodes,
        "reward": jnp.mean(moments.reward),
        "nonfinite": jnp.sum(moments.nonfinite),
    }
