"""brax's side of the comparison with our PPO: `brax.training.agents.ppo.train`, as released.

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
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from .bench_pendulum import Pendulum, Setting

__all__ = ["BraxPendulum", "stand_in", "train"]


class BraxPendulum(Env):
    """The same pendulum behind brax's interface; its state is ours."""

    def __init__(self) -> None:
        self._task = Pendulum()

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
    seed: int, setting: Setting, progress: Callable[[int, float, float], None] = lambda *_: None
) -> list[float]:
    """Returns of sampled actions at each evaluation; as many episodes as there are environments.

    Args:
      seed: of the run.
      setting: hyper-parameters and length.
      progress: called after each evaluation with the steps so far, the return, and the steps a
        second of the part before it, as brax reports them: without the evaluation.
    """
    returns: list[float] = []

    def note(steps, metrics):
        returns.append(float(metrics["eval/episode_reward"]))
        progress(int(steps), returns[-1], float(metrics.get("training/sps", 0.0)))

    with stand_in():
        stock.train(
            BraxPendulum(),
            num_timesteps=setting.num_timesteps,
            num_evals=setting.num_evals,
            num_eval_envs=setting.num_envs,
            max_devices_per_host=1,
            episode_length=Pendulum.episode_length,
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
            progress_fn=note,
        )
    return returns
