"""The sections of the configuration that train a policy, one for each algorithm.

Both have the fields of `PolicyConfig`, with defaults of their own. Rarely
changed values, such as the rate of SAC's target networks, are arguments of the library alone: see
`Static` and `Hyper` of `gril_jax.rl.ppo` and `gril_jax.rl.sac`.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

from gril_jax.errors import ConfigError

from .tables import above, at_least, between, rule

_WIDTHS = rule(lambda x: all(w >= 1 for w in x), "a list of widths of at least 1")


@dataclass(frozen=True)
class PolicyConfig:
    """The options of every algorithm."""

    num_timesteps: int = field(default=1_000_000, metadata=at_least(1))
    """Environment steps in all."""
    num_envs: int = field(default=64, metadata=at_least(1))
    """Environments that step together."""
    unroll_length: int = field(default=20, metadata=at_least(1))
    """Steps of each environment between two rounds of gradient steps."""
    learning_rate: float = field(default=3e-4, metadata=above(0))
    """Learning rate of Adam."""
    discounting: float = field(default=0.99, metadata=between(0, 1))
    """Discount factor of a step."""
    reward_scaling: float = field(default=1.0, metadata=above(0))
    """Factor on the reward in the value function or the critics."""
    hidden: tuple[int, ...] = field(default=(64, 64), metadata=_WIDTHS)
    """Widths of the hidden layers of each network."""
    observe_activity: bool | None = None
    """True if the policy sees which objects have moved, as the reward does. None: True unless the
    observation is xmagical."""
    observe_gradient: bool = False
    """True if the policy sees the gradient of the learned reward with respect to each object's
    centre, which says where it should go. For layouts that the videos do not show."""
    visited_state_resets: float = field(default=0.0, metadata=between(0, 1))
    """Fraction of training episodes that begin at states which the policy has visited, sampled
    evenly over their rewards. It falls to 0 over the first nine tenths of training."""
    video_state_resets: float = field(default=0.0, metadata=between(0, 1))
    """Fraction of training episodes that begin at states which the videos show. It falls to 0 over
    the first nine tenths of training."""

    def check(self, name: str) -> None:
        """Raises ConfigError if sizes do not fit together; `name` is the section's."""
        unroll = self.num_envs * self.unroll_length
        if self.num_timesteps < unroll:
            raise ConfigError(
                f"{name}.num_timesteps is {self.num_timesteps}, but must cover one update of "
                f"{name}.num_envs x {name}.unroll_length = {unroll} steps"
            )


@dataclass(frozen=True)
class PPOConfig(PolicyConfig):
    """Policy training by proximal policy optimisation."""

    num_minibatches: int = field(default=4, metadata=at_least(1))
    """Minibatches of an update. The number divides num_envs."""
    num_epochs: int = field(default=4, metadata=at_least(1))
    """Passes over the data of an update."""
    final_learning_rate_fraction: float = field(default=1.0, metadata=between(0, 1))
    """Fraction of the learning rate at the end; it falls linearly."""
    gae_lambda: float = field(default=0.95, metadata=between(0, 1))
    """Lambda of generalised advantage estimation."""
    entropy_cost: float = field(default=1e-2, metadata=at_least(0))
    """Weight of the policy's entropy."""
    final_entropy_fraction: float = field(default=1.0, metadata=between(0, 1))
    """Fraction of that weight at the end; it falls linearly."""
    clipping_epsilon: float = field(default=0.2, metadata=between(0.001, 1))
    """Clipping range of the probability ratio."""
    by_object: bool = False
    """True if the policy reads each object with the same weights. Order and number of objects then
    do not matter."""
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """Numbers that a policy which reads objects multiplies: auto is bfloat16 on a GPU, float32
    elsewhere. Weights and losses are float32."""
    sub_policies: int = field(default=1, metadata=between(1, 8))
    """Networks, one for each stage of the learned reward. With another `--reward` than stages
    there is one."""
    noise_correlation: float = field(default=0.0, metadata=between(0, 1))
    """Fraction of the variance of an action's noise that stays the same between two updates, so
    that an environment explores in one direction."""

    def check(self, name: str) -> None:
        """Raises ConfigError if sizes do not fit together; `name` is the section's."""
        super().check(name)
        if self.num_envs % self.num_minibatches:
            raise ConfigError(
                f"{name}.num_minibatches is {self.num_minibatches}, but must divide "
                f"{name}.num_envs, which is {self.num_envs}"
            )


@dataclass(frozen=True)
class SACConfig(PolicyConfig):
    """Policy training by soft actor-critic."""

    num_timesteps: int = field(default=500_000, metadata=at_least(1))
    unroll_length: int = field(default=4, metadata=at_least(1))
    hidden: tuple[int, ...] = field(default=(128, 128), metadata=_WIDTHS)
    updates_per_step: int = field(default=8, metadata=at_least(1))
    """Gradient steps of each round."""
    batch_size: int = field(default=256, metadata=at_least(1))
    """Transitions in a batch."""
    replay_size: int = field(default=2**17, metadata=at_least(1))
    """Transitions in the replay buffer; a multiple of num_envs x unroll_length."""
    min_replay: int = field(default=2**13, metadata=at_least(0))
    """Transitions before learning begins. Until then actions are random."""

    def check(self, name: str) -> None:
        """Raises ConfigError if sizes do not fit together; `name` is the section's."""
        super().check(name)
        check_replay(self, f"{name}.")


def check_replay(sizes: Any, section: str = "") -> None:
    """Raises ConfigError if a replay does not fit the environments; `section` precedes fields."""
    unroll = sizes.num_envs * sizes.unroll_length
    if sizes.replay_size % unroll:
        fitting = max(1, sizes.replay_size // unroll) * unroll
        raise ConfigError(
            f"{section}replay_size is {sizes.replay_size}, but must be a multiple of "
            f"{section}num_envs x {section}unroll_length = {unroll}, such as {fitting}"
        )
    if sizes.min_replay > sizes.replay_size:
        raise ConfigError(
            f"{section}min_replay is {sizes.min_replay}, but must be at most "
            f"{section}replay_size, which is {sizes.replay_size}"
        )
