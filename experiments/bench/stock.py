"""brax's side of the comparison: `brax.training.agents.ppo.train` and that of SAC, as released.

brax 0.14.2 calls `jax.device_put_replicated`, which JAX 0.10 has no more. `stand_in` fills that gap
for as long as brax trains here; the rest is stock.
"""

import contextlib
import functools
from collections.abc import Callable
from typing import Any
from unittest import mock

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
from gril_jax.envs import Env as Task
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from .pendulum import Pendulum, SacSetting, Setting


class BraxTask(Env):
    """One of our tasks behind brax's interface; its state is ours."""

    observation_size, action_size, backend = 0, 0, "none"  # the sizes are each task's own

    def __init__(self, task: Task) -> None:
        self._task = task
        self.observation_size, self.action_size = task.observation_size, task.action_size

    def reset(self, rng: jax.Array) -> BraxState:
        state = self._task.reset(rng)
        return BraxState(state, state.obs, state.reward, state.done)

    def step(self, state: BraxState, action: jax.Array) -> BraxState:
        after = self._task.step(state.pipeline_state, action)
        return state.replace(
            pipeline_state=after, obs=after.obs, reward=after.reward, done=after.done
        )


def _replicated(tree: Any, devices: Any) -> Any:
    """Copies a tree along a new axis, named as in brax's pmap to avoid compiling twice."""
    placed = NamedSharding(Mesh(np.array(devices), ("i",)), PartitionSpec("i"))
    return jax.tree.map(lambda x: jax.device_put(jnp.stack([x] * len(devices)), placed), tree)


def stand_in() -> contextlib.AbstractContextManager[Any]:
    """Provides `jax.device_put_replicated` inside a `with` block."""
    return mock.patch.object(jax, "device_put_replicated", _replicated, create=True)


def train(
    seed: int,
    setting: Setting | SacSetting,
    progress: Callable[[int, float, float], None] = lambda *_: None,
    *,
    task: Task | None = None,
    eval_envs: int | None = None,
    mean_actions: bool = False,
) -> list[float]:
    """Returns at each evaluation; of PPO or SAC, after the kind of setting.

    `progress` gets the steps so far, the return, and the steps a second of the part before it,
    as brax reports them: without the evaluation. Without a task it is the pendulum; an
    evaluation has as many episodes as there are environments, unless told otherwise.
    """
    task = Pendulum() if task is None else task
    returns: list[float] = []

    def note(steps, metrics):
        returns.append(float(metrics["eval/episode_reward"]))
        progress(int(steps), returns[-1], float(metrics.get("training/sps", 0.0)))

    hidden = setting.hidden
    if isinstance(setting, SacSetting):
        run, options, given, make = stock_sac.train, _SAC, {}, sac_networks.make_sac_networks
        sizes = {"hidden_layer_sizes": hidden, "activation": linen.swish}
    else:
        run, options, make = stock.train, _PPO, networks.make_ppo_networks
        given = {"batch_size": setting.num_envs // setting.num_minibatches}
        sizes = {"policy_hidden_layer_sizes": hidden, "value_hidden_layer_sizes": hidden}
    given |= {name: getattr(setting, own) for name, own in (_BOTH | options).items()}
    with stand_in():
        run(
            BraxTask(task), num_eval_envs=eval_envs or setting.num_envs,
            deterministic_eval=mean_actions, max_devices_per_host=1,
            episode_length=task.episode_length, normalize_observations=True, seed=seed,
            progress_fn=note, network_factory=functools.partial(make, **sizes), **given,
        )  # fmt: skip
    return returns


# brax's options, by the names that they have in our settings.
_SAME = ("num_timesteps", "num_evals", "num_envs", "learning_rate", "discounting", "reward_scaling")
_BOTH = {name: name for name in _SAME}
_OF_PPO = (
    "unroll_length", "num_minibatches", "gae_lambda", "entropy_cost", "clipping_epsilon",
    "max_grad_norm",
)  # fmt: skip
_PPO = {name: name for name in _OF_PPO} | {"num_updates_per_batch": "num_epochs"}
_SAC = {
    "grad_updates_per_step": "updates_per_step", "batch_size": "batch_size",
    "max_replay_size": "replay_size", "min_replay_size": "min_replay", "tau": "soft_update",
}  # fmt: skip


def all_returns(
    setting: Setting | SacSetting, task: Task, seeds: int, episodes: int
) -> list[list[float]]:
    """Returns of mean actions over so many episodes, per seed one at each evaluation."""
    return [
        train(seed, setting, task=task, eval_envs=episodes, mean_actions=True)
        for seed in range(seeds)
    ]
