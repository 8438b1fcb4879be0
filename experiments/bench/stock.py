"""brax's side of the comparison: `brax.training.agents.ppo.train` and that of SAC, as released.

brax 0.14.2 calls `jax.device_put_replicated`, which JAX 0.10 has no more. `stand_in` fills that gap
for as long as brax trains here; the rest is stock.
"""

import contextlib
import functools
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs.base import Env
from brax.envs.base import State as BraxState
from brax.training.agents.ppo import networks
from brax.training.agents.ppo import train as stock
from brax.training.agents.sac import networks as sac_networks
from brax.training.agents.sac import train as stock_sac
from flax import linen
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from .pendulum import Pendulum, SacSetting, Setting

__all__ = ["BraxTask", "all_returns", "stand_in", "train", "train_sac"]

Progress = Callable[[int, float, float], None]


class BraxTask(Env):
    """The same task behind brax's interface; its state is ours."""

    def __init__(self, task: Any) -> None:
        self._task = task

    def reset(self, rng: jax.Array) -> BraxState:
        state = self._task.reset(rng)
        return BraxState(state, state.obs, state.reward, state.done)

    def step(self, state: BraxState, action: jax.Array) -> BraxState:
        after = self._task.step(state.pipeline_state, action)
        return state.replace(
            pipeline_state=after, obs=after.obs, reward=after.reward, done=after.done
        )

    @property
    def observation_size(self) -> int:
        return self._task.observation_size

    @property
    def action_size(self) -> int:
        return self._task.action_size

    @property
    def backend(self) -> str:
        return "none"


def _replicated(tree: Any, devices: Any) -> Any:
    """The copies on an axis of its own, named as brax's pmap names it, or that compiles twice."""
    placed = NamedSharding(Mesh(np.array(devices), ("i",)), PartitionSpec("i"))
    return jax.tree.map(lambda x: jax.device_put(jnp.stack([x] * len(devices)), placed), tree)


@contextlib.contextmanager
def stand_in() -> Iterator[None]:
    """`jax.device_put_replicated` is there, if only inside."""
    missing = object()
    before = vars(jax).get("device_put_replicated", missing)
    jax.device_put_replicated = _replicated  # ty: ignore
    try:
        yield
    finally:
        if before is missing:
            del jax.device_put_replicated
        else:
            jax.device_put_replicated = before


def train(
    seed: int,
    setting: Setting,
    progress: Progress = lambda *_: None,
    *,
    task: Any = None,
    eval_envs: int | None = None,
    mean_actions: bool = False,
) -> list[float]:
    """Returns of PPO at each evaluation.

    Args:
      seed: of the run.
      setting: hyper-parameters and length.
      progress: called after each evaluation with the steps so far, the return, and the steps a
        second of the part before it, as brax reports them: without the evaluation.
      task: what to train on; None is the pendulum.
      eval_envs: episodes of an evaluation; None is as many as there are environments.
      mean_actions: whether those are played with mean actions, and not with samples.
    """
    task = Pendulum() if task is None else task
    returns: list[float] = []
    with stand_in():
        stock.train(
            BraxTask(task),
            num_timesteps=setting.num_timesteps,
            num_evals=setting.num_evals,
            num_eval_envs=eval_envs or setting.num_envs,
            deterministic_eval=mean_actions,
            max_devices_per_host=1,
            episode_length=task.episode_length,
            num_envs=setting.num_envs,
            unroll_length=setting.unroll_length,
            batch_size=setting.num_envs // setting.num_minibatches,
            num_minibatches=setting.num_minibatches,
            num_updates_per_batch=setting.num_epochs,
            network_factory=functools.partial(
                networks.make_ppo_networks,
                policy_hidden_layer_sizes=setting.hidden,
                value_hidden_layer_sizes=setting.hidden,
            ),
            normalize_observations=True,
            learning_rate=setting.learning_rate,
            discounting=setting.discounting,
            gae_lambda=setting.gae_lambda,
            entropy_cost=setting.entropy_cost,
            clipping_epsilon=setting.clipping_epsilon,
            reward_scaling=setting.reward_scaling,
            max_grad_norm=setting.max_grad_norm,
            seed=seed,
            progress_fn=_noting(returns, progress),
        )
    return returns


def train_sac(seed: int, setting: SacSetting, *, task: Any, eval_envs: int) -> list[float]:
    """Returns of SAC's mean actions at each evaluation, of `eval_envs` episodes each."""
    returns: list[float] = []
    with stand_in():
        stock_sac.train(
            BraxTask(task),
            num_timesteps=setting.num_timesteps,
            num_evals=setting.num_evals,
            num_eval_envs=eval_envs,
            deterministic_eval=True,
            max_devices_per_host=1,
            episode_length=task.episode_length,
            num_envs=setting.num_envs,
            grad_updates_per_step=setting.updates_per_step,
            batch_size=setting.batch_size,
            max_replay_size=setting.replay_size,
            min_replay_size=setting.min_replay,
            network_factory=functools.partial(
                sac_networks.make_sac_networks,
                hidden_layer_sizes=setting.hidden,
                activation=linen.swish,
            ),
            normalize_observations=True,
            learning_rate=setting.learning_rate,
            discounting=setting.discounting,
            tau=setting.soft_update,
            reward_scaling=setting.reward_scaling,
            seed=seed,
            progress_fn=_noting(returns, lambda *_: None),
        )
    return returns


def _noting(returns: list[float], progress: Progress) -> Callable[[int, Any], None]:
    """What brax calls after each evaluation."""

    def note(steps, metrics):
        returns.append(float(metrics["eval/episode_reward"]))
        progress(int(steps), returns[-1], float(metrics.get("training/sps", 0.0)))

    return note


def all_returns(
    setting: Setting | SacSetting, task: Any, seeds: int, episodes: int
) -> list[list[float]]:
    """Returns of mean actions, for each seed one at each evaluation; one seed after the other.

    Each is the mean over so many `episodes`.
    """
    if isinstance(setting, SacSetting):
        return [train_sac(seed, setting, task=task, eval_envs=episodes) for seed in range(seeds)]
    return [
        train(seed, setting, task=task, eval_envs=episodes, mean_actions=True)
        for seed in range(seeds)
    ]
