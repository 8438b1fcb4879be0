"""Settings of `gril bench known`: hyper-parameters, and the returns to compare with.

The hyper-parameters serve both sides alike. What brax's SAC has fixed is fixed for ours too: the
temperature begins at 1 and learns with 3e-4, towards -0.5 nats for each number of an action.
"""

from typing import Any, NamedTuple

from .known_tasks import InvertedPendulum, Reacher
from .pendulum import Pendulum, SacSetting, Setting

__all__ = ["GROUND", "Ground", "Published"]


class Published(NamedTuple):
    """A published return to compare with."""

    mean: float
    spread: float  # one standard deviation, over episodes or over runs: see `source`
    source: str


class Ground(NamedTuple):
    """One task with its settings for training."""

    task: type[Any]
    settings: dict[str, Setting | SacSetting]  # of each algorithm
    published: dict[str, Published]


_ZOO = "RL Baselines3 Zoo, benchmark.md: one run, spread over 750 episodes; steps {}"
_TIANSHOU = "Tianshou, examples/mujoco: best of 1M steps, mean and spread over 10 runs"

GROUND = {
    "pendulum": Ground(
        Pendulum,
        {
            "ppo": Setting(num_timesteps=204_800, num_epochs=8),
            "sac": SacSetting(),
        },
        {
            "ppo": Published(-172.2, 104.2, _ZOO.format("100k")),
            "sac": Published(-157.0, 88.7, _ZOO.format("20k")),
        },
    ),
    "inverted_pendulum": Ground(
        InvertedPendulum,
        {
            "ppo": Setting(num_timesteps=307_200, learning_rate=5e-4, discounting=0.99),
            "sac": SacSetting(num_timesteps=40_960, discounting=0.99, reward_scaling=0.1),
        },
        {
            "ppo": Published(1000.0, 0.0, _TIANSHOU),
            "sac": Published(1000.0, 0.0, _TIANSHOU),
        },
    ),
    "reacher": Ground(
        Reacher,
        {
            "ppo": Setting(num_timesteps=512_000, unroll_length=10, num_minibatches=16,
                           num_epochs=8, entropy_cost=0.0, reward_scaling=1.0),
            "sac": SacSetting(num_timesteps=40_960, discounting=0.95, reward_scaling=10.0),
        },
        {
            "ppo": Published(-4.1, 0.3, _TIANSHOU),
            "sac": Published(-2.6, 0.2, _TIANSHOU),
        },
    ),
}  # fmt: skip
