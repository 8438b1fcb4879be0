"""GAIL on human demonstrations with their actions, a baseline that knows more: JSON.

    python -m gril_jax.experiments.baselines.gail recorded.json --sets SETS --out gail.json

Ho and Ermon, NeurIPS 2016: a discriminator learns to tell the demonstrations' pairs of observation
and action from the policy's, and PPO's reward is -log(1 - D); a gradient penalty (Gulrajani et al.
2017) regularises the discriminator. The policy's actions are replaced by the nearest of MAGICAL's
18. Sized for a GPU; on a laptop: --num-envs 256 --num-minibatches 4 --num-timesteps 1500000.

Shapes use F for the demonstrations' pairs, K for seeds, T for control steps, B for environments, O
for an observation, A for an action and I for both.
"""

import dataclasses
import sys
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
import tyro
from flax import linen as nn
from gril_jax.envs import Env
from jaxtyping import Array, Float, Int

from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.demos.demo_set import demo_batch, load_demo_set
from gril_jax.rl import ppo
from gril_jax.workflows.build import policy_rewards, policy_setup, setup
from gril_jax.workflows.study import recipe, variants
from gril_jax.workflows.study.recipe import changed

from . import cloning

_MINIBATCH = 512  # pairs of each side
_PENALTY = 10.0  # of gradients whose norm is not 1, between pairs of both sides
_LARGEST = 10.0  # of a discriminator's input, in deviations of the demonstrations


@dataclasses.dataclass(frozen=True)
class Options(cloning.RecordedOptions):
    """The command's."""

    variant: str = "demo"
    """Starts of training episodes: of Demo, and first of the videos' frames, or those of a variant
    such as all."""
    num_timesteps: int = 12_000_000
    """Control steps of a policy in a task of middle length, as in a suite."""
    num_envs: int = 4096
    """Environments that are stepped together."""
    num_minibatches: int = 32
    """Minibatches of PPO's."""
    updates: int = 4
    """Gradient steps of the discriminator for each unroll."""
    learning_rate: float = 3e-4
    """Of the discriminator."""


class Discrete:
    """A task whose actions are replaced by the nearest of MAGICAL's 18."""

    def __init__(self, env: Env):
        self._env, self._table = env, np.asarray(cloning.table())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._env, name)

    def nearest(self, action: Float[Array, "*batch A"]) -> Float[Array, "*batch A"]:
        """The nearest of the 18."""
        apart = ((action[..., None, :] - self._table) ** 2).sum(axis=-1)
        return jnp.asarray(self._table)[jnp.argmin(apart, axis=-1)]

    def step(self, state: Any, action: Float[Array, "A"]) -> Any:
        """One control step with the nearest action."""
        return self._env.step(state, self.nearest(action))


class Expert(NamedTuple):
    """Pairs of the demonstrations, and how their observations are distributed."""

    obs: Float[Array, "F O"]
    action: Float[Array, "F A"]
    middle: Float[Array, "O"]
    spread: Float[Array, "O"]


class Learner(NamedTuple):
    """Everything that training depends on."""

    policy: ppo.TrainState
    weights: Any
    moments: Any


class Gail:
    """PPO on a reward that is learned beside it; `init` and `step` are pure."""

    def __init__(self, algorithm: ppo.PPO, expert: Expert, *, updates: int, learning_rate: float):
        self.algorithm, self._expert, self._updates = algorithm, expert, updates
        self._rule = optax.adam(learning_rate, b1=0.5)
        self._network = _Network()

    def init(self, key: Array, hyper: Any) -> Learner:
        """Fresh networks and environments. The key is consumed."""
        key, key_weights = jax.random.split(key)
        one = self._pair(self._expert.obs[0], self._expert.action[0])
        weights = self._network.init(key_weights, one)
        return Learner(self.algorithm.init(key, hyper), weights, self._rule.init(weights))

    def step(self, state: Learner, hyper: Any, reward_params: Any) -> tuple[Learner, dict]:
        """One unroll, what the discriminator and then the policy learn from it, and metrics."""
        algorithm, key = self.algorithm, state.policy.key
        following = jax.random.split(key, algorithm.num_keys)[0]
        sampled = jnp.zeros((algorithm.num_envs,), bool)
        policy, steps = algorithm.collect(
            state.policy._replace(key=following), key, hyper, reward_params, deterministic=sampled
        )
        actions = algorithm.env.nearest(steps.action)
        own = self._pair(steps.observation, actions)
        weights, moments, right = self._discriminate(state, jax.random.fold_in(key, 0), own)
        reward = jax.nn.softplus(self._network.apply(weights, own))
        steps = steps._replace(result=steps.result._replace(reward=reward))
        policy, metrics = algorithm.learn(policy, steps, key, hyper, reward_params)
        return Learner(policy, weights, moments), metrics | {"told_apart": right}

    def _pair(self, obs, action):
        """The discriminator's input."""
        seen = (obs - self._expert.middle) / self._expert.spread
        return jnp.concatenate([jnp.clip(seen, -_LARGEST, _LARGEST), action], axis=-1)

    def _discriminate(self, state: Learner, key, own: Float[Array, "T B I"]):
        """The discriminator after some gradient steps, and the share of pairs it tells apart."""
        own = own.reshape(-1, own.shape[-1])
        theirs = self._pair(self._expert.obs, self._expert.action)

        def loss(weights, key):
            keys = jax.random.split(key, 3)
            at = jax.random.randint(keys[0], (_MINIBATCH,), 0, len(own))
            there = jax.random.randint(keys[1], (_MINIBATCH,), 0, len(theirs))
            pairs = own[at], theirs[there]
            logits = [self._network.apply(weights, x) for x in pairs]
            fooled = jnp.mean(jax.nn.softplus(logits[0])) + jnp.mean(jax.nn.softplus(-logits[1]))
            right = (jnp.mean(logits[0] < 0) + jnp.mean(logits[1] > 0)) / 2
            share = jax.random.uniform(keys[2], (_MINIBATCH, 1))
            between = share * pairs[0] + (1 - share) * pairs[1]
            slope = jax.vmap(jax.grad(lambda x: self._network.apply(weights, x)))(between)
            norm = jnp.sqrt((slope**2).sum(axis=-1) + 1e-12)
            return fooled + _PENALTY * jnp.mean((norm - 1.0) ** 2), right

        def update(carry, key):
            weights, moments = carry
            slope, right = jax.grad(loss, has_aux=True)(weights, key)
            change, moments = self._rule.update(slope, moments)
            return (optax.apply_updates(weights, change), moments), right

        keys = jax.random.split(key, self._updates)
        (weights, moments), right = jax.lax.scan(update, (state.weights, state.moments), keys)
        return weights, moments, right[-1]


class _Network(nn.Module):
    """The discriminator's logit: above 0 for what looks like the demonstrations."""

    @nn.compact
    def __call__(self, x):
        for width in (256, 256):
            x = nn.tanh(nn.Dense(width)(x))
        return nn.Dense(1)(x)[..., 0]


def configured(task: str, options: Options) -> RunConfig:
    """The suite's configuration of a task, without a reward of its own."""
    suite = recipe.load("suite")
    change = {
        "ppo.num_timesteps": options.num_timesteps,
        "env.variant": options.variant,
        "ppo.num_envs": options.num_envs,
        "ppo.num_minibatches": options.num_minibatches,
        "ppo.observe_activity": False,  # the pairs of the demonstrations have none
    }
    if options.variant != variants.DEMO:  # no video shows its starts
        change["ppo.video_state_resets"] = 0.0
    config = changed(load("magical_suite"), {**suite.changes, **change})
    return changed(config, suite.rows[f"{task} from its score"])


def measure(task: str, actions: Int[np.ndarray, "D T"], options: Options) -> dict[str, Any]:
    """Figures of a task's policies in all variants."""
    config = configured(task, options)
    demo = setup.make_env(config.env, training=False, variant=variants.DEMO)
    obs, chosen = cloning.of_task(demo, actions, options.sets / task)
    expert = Expert(
        *(jnp.asarray(x) for x in (obs, cloning.table()[chosen], obs.mean(axis=0))),
        spread=jnp.asarray(obs.std(axis=0)) + 0.1,
    )
    env = Discrete(setup.make_env(config.env, training=True))
    gail = Gail(
        policy_setup.make_algorithm(config, env), expert,
        updates=options.updates, learning_rate=options.learning_rate,
    )  # fmt: skip
    films = demo_batch(load_demo_set(options.sets / task))
    params = policy_rewards.parameters(config, None, films, len(env.classes))
    policies, metrics = train(gail, config, params, seeds=options.seeds)
    on = variants.ground(config, options.seeds, options.starts, wrap=Discrete)
    found, _ = variants.figures(on, policies)
    return {"pairs": len(chosen), "told_apart": metrics["told_apart"].tolist(), **found}


def train(gail: Gail, config: RunConfig, params: Any, *, seeds: int):
    """Policies (K, ...) after all updates, and the last metrics (K,)."""
    hyper = policy_setup.algorithm_hyper(config)
    updates = int(hyper.decay_updates)

    def one(key):
        state = gail.init(key, hyper)
        move = lambda carry, _: (gail.step(carry, hyper, params)[0], None)  # noqa: E731
        state, _ = jax.lax.scan(move, state, length=updates - 1)
        state, metrics = gail.step(state, hyper, params)
        return gail.algorithm.policy(state.policy), metrics

    return jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(0), seeds))


def main(argv: list[str] | None = None) -> int:
    """Writes the results after each task, and prints them."""
    return cloning.measured("gail", tyro.cli(Options, args=argv), measure)


if __name__ == "__main__":
    sys.exit(main())
