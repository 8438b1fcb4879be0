"""Soft actor-critic with rollout, reward, replay and gradient steps in one pure function.

Networks, losses, action distribution and observation statistics are brax's; the step that joins
them and the replay are ours (`sac_loss` has the gradient step). Everything that the next step
depends on is in `TrainState`, the replay included, so that saving it is enough to go on.

A time limit is no end: its transition leads to the observation before the reset, and bootstraps
from there like any other. Only steps that a failure took back are left out of the critic's loss.

Shapes use B for environments, T for the control steps of one unroll and R for rows of the replay.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from brax.training.acme import running_statistics
from brax.training.agents.sac import networks
from brax.training.types import Transition
from flax import linen
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.config.policy import SACConfig, check_replay

from . import replay, rollout, sac_loss
from .agent import Agent, Sizes
from .episodes import Environment
from .policy import Policy, fresh_normalizer, normalize, observed
from .rewards import AnyReward
from .sac_loss import Hyper, Learned


@dataclasses.dataclass(frozen=True)
class Static(Sizes):
    """Static options, with SAC's own."""

    num_envs: int = SACConfig.num_envs
    unroll_length: int = SACConfig.unroll_length
    hidden: tuple[int, ...] = SACConfig.hidden
    updates_per_step: int = SACConfig.updates_per_step  # gradient steps after each unroll
    batch_size: int = SACConfig.batch_size
    replay_size: int = SACConfig.replay_size  # transitions, a multiple of those of one unroll
    min_replay: int = SACConfig.min_replay  # transitions before learning; till then at random


class TrainState(NamedTuple):
    """Everything that training depends on."""

    learned: Learned
    normalizer: running_statistics.RunningStatisticsState
    replay: replay.Replay  # of `Row`
    envs: rollout.VectorState  # (B, ...)
    key: PRNGKeyArray
    updates: Int[Array, ""]  # unrolls so far


class Row(NamedTuple):
    """One transition in the replay."""

    observation: Float[Array, "O"]
    action: Float[Array, "A"]
    next_observation: Float[Array, "O"]  # before any reset
    discount: Float[Array, ""]  # 0 where the task ended
    dropped: Float[Array, ""]  # 1 where the step was taken back
    reward: Float[Array, ""]


class SAC(Agent):
    """SAC for one task and one reward; its functions are pure, for `jit`, `vmap` and `scan`.

        state = algorithm.init(key, hyper)
        state, metrics = algorithm.step(state, hyper, reward_params)

    The task, the reward function and `static` shape the compiled program. The key, the state,
    `hyper` and the reward's parameters are traced: a `vmap` sweeps them.

    Raises ConfigError if sizes do not fit together.
    """

    Static, Hyper = Static, Hyper

    def __init__(self, env: Environment, reward: AnyReward, static: Static):
        self.static = static
        super().__init__(env, reward, static, 1 + static.updates_per_step)
        check_replay(static)
        self.networks = networks.make_sac_networks(
            self.observation_size, env.action_size, preprocess_observations_fn=normalize,
            hidden_layer_sizes=static.hidden,
            activation=linen.swish,  # as in PPO, so that policies are exported alike
        )  # fmt: skip
        self._make_policy = networks.make_inference_fn(self.networks)

    def init(self, key: PRNGKeyArray, hyper: Hyper) -> TrainState:
        """Initial weights, an empty replay, and B environments at random times of an episode.

        The key is consumed.
        """
        key, key_weights, envs = self._begin(key)
        learned = sac_loss.begin(self.networks, key_weights, hyper)
        normalizer = fresh_normalizer(self.observation_size)
        stored = replay.init(self._row(), self.static.replay_size)
        return TrainState(learned, normalizer, stored, envs, key, jnp.zeros((), jnp.int32))

    def policy(self, state: TrainState) -> Policy:
        """The part of the state that acting needs."""
        return Policy(state.normalizer, state.learned.params.policy)

    def collect(
        self,
        state: TrainState,
        key: PRNGKeyArray,
        hyper: Hyper,
        reward_params: Any,
        *,
        deterministic: Bool[Array, "B"],
    ) -> tuple[TrainState, rollout.Rollout]:
        """T control steps of every environment; `deterministic` ones play mean actions.

        The others act at random, uniformly, until the replay holds `min_replay` transitions.
        """
        explore = self._make_policy(tuple(self.policy(state)))
        exploit = self._make_policy(tuple(self.policy(state)), deterministic=True)

        def act(observation, key):
            key_policy, key_uniform = jax.random.split(key)
            drawn, _ = explore(observation, key_policy)
            mean, _ = exploit(observation, key_policy)
            uniform = jax.random.uniform(key_uniform, drawn.shape, minval=-1.0)
            action = jnp.where(self._ready(state), drawn, uniform)
            return jnp.where(deterministic[:, None], mean, action), ()

        return self._unroll(state, key, act, hyper, reward_params)

    def store(
        self, state: TrainState, steps: rollout.Rollout, *, wanted: Bool[Array, ""] | bool = True
    ) -> TrainState:
        """The state with these transitions added to its replay, if they are wanted."""
        rows = Row(
            observation=steps.observation,
            action=steps.action,
            next_observation=steps.last,
            discount=1.0 - steps.result.terminated,
            dropped=steps.result.nonfinite,
            reward=steps.result.reward,
        )
        rows = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), rows)
        return state._replace(replay=replay.insert(state.replay, rows, wanted=wanted))

    def learn(
        self,
        state: TrainState,
        steps: rollout.Rollout,
        key: PRNGKeyArray,
        hyper: Hyper,
        reward_params: Any,
    ) -> tuple[TrainState, dict[str, Float[Array, ""]]]:
        """Runs `updates_per_step` gradient steps, each on a batch sampled from the replay.

        Too early they are computed all the same, and thrown away: seeds side by side could not skip
        them either.
        """
        del reward_params  # each transition has the reward that it had when it was collected
        keys = self._split(key)[-1]
        normalizer = observed(state.normalizer, steps.observation)
        count, size = self.static.updates_per_step, self.static.batch_size
        rows = replay.sample(state.replay, keys[0], count * size)
        data = self._transitions(rows)
        batches = jax.tree.map(lambda x: x.reshape(count, size, *x.shape[1:]), data)

        def update(learned, batch_and_key):
            return sac_loss.gradient_step(self.networks, learned, normalizer, *batch_and_key, hyper)

        learned, metrics = jax.lax.scan(update, state.learned, (batches, keys[1:]))
        ready = self._ready(state)
        learned = jax.tree.map(lambda new, old: jnp.where(ready, new, old), learned, state.learned)
        metrics = {name: jnp.where(ready, jnp.mean(x), 0.0) for name, x in metrics.items()}
        metrics |= {"alpha": jnp.exp(learned.params.log_alpha)}
        state = state._replace(learned=learned, normalizer=normalizer, updates=state.updates + 1)
        return state, rollout.summary(steps) | metrics

    def _ready(self, state: TrainState) -> Bool[Array, ""]:
        return state.replay.size >= self.static.min_replay

    def _row(self) -> Row:
        """Shapes of one row."""
        sizes = (), (self.observation_size,), (self.env.action_size,)
        number, observation, action = (jax.ShapeDtypeStruct(s, jnp.float32) for s in sizes)
        return Row(observation, action, observation, number, number, number)

    def _transitions(self, rows: Row) -> Transition:
        """The rows as transitions (R, ...) for brax's losses, which skip truncated ones."""
        return Transition(
            observation=rows.observation,
            action=rows.action,
            reward=rows.reward,
            discount=rows.discount,
            next_observation=rows.next_observation,
            extras={"policy_extras": {}, "state_extras": {"truncation": rows.dropped}},
        )
