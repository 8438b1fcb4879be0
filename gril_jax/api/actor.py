"""A trained policy that acts in a loop of yours.

    actor = policy.actor()
    seen = actor.begin(center)                  # boxes' centres at the episode's start
    while ...:
        action = actor.act(seen, observation)   # to your simulator or robot
        seen = actor.see(seen, center, size)    # the boxes after it

All three are pure functions: `jax.jit`, `jax.vmap` and `jax.lax.scan` take them. Every policy has
an actor, also one with a network for each stage, or one that reads objects one by one.

Shapes use N for the task's objects, in its order, O for its observation and A for its action.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from gril_jax.errors import ShapeError
from gril_jax.graphs import activity
from gril_jax.rl.episodes import EpisodeState
from gril_jax.rl.policy import Policy
from gril_jax.rl.training import Algorithm
from gril_jax.types import checked


class Seen(NamedTuple):
    """The memory that a policy has of an episode."""

    memory: activity.Memory  # which objects have moved
    remembered: Any  # by the reward, such as the stages that are done
    label: Int[Array, "N"]  # class of each object


class _State(NamedTuple):
    """The part of a task's state that policies and rewards read."""

    objects: Any
    obs: Any = ()
    reward: float = 0.0  # of the task, which a policy does not see
    done: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Actor:
    """One policy, and the reward whose memory it observes."""

    algorithm: Algorithm
    parameters: Policy
    reward_parameters: Any
    objects: Any
    """Of a start of the task: its robot flags count in every episode."""
    observation_size: int
    """O, of the task's own observation."""
    tau: float
    """Activity threshold, in box diagonals."""

    @checked
    def begin(self, center: Float[Array, "N 2"], label: Int[Array, "N"] | None = None) -> Seen:
        """The memory at an episode's start.

        Args:
          center: of all boxes, in world units.
          label: class of each object, where it differs from episode to episode, as in a variant
            with other colours. By default the classes are those of one start of the task.

        Raises:
          ShapeError: there are more or fewer boxes or labels than the task has objects.
        """
        _require("center", center.shape, self.objects.center.shape)
        label = self.objects.label if label is None else label
        _require("label", label.shape, self.objects.label.shape)
        episodes = self.algorithm.episodes
        memory = activity.init(center, window=episodes.window, smoothing=episodes.smoothing)
        return Seen(memory, episodes.reward.init(), label)

    @checked
    def see(self, seen: Seen, center: Float[Array, "N 2"], size: Float[Array, "N 2"]) -> Seen:
        """The memory after a control step, from the boxes then, in world units."""
        episodes = self.algorithm.episodes
        memory, active = activity.step(
            seen.memory, center, size, tau=self.tau, noise=episodes.noise
        )
        remembered = seen.remembered
        if episodes.reward.observe(remembered).size:  # else no reward needs to be computed
            objects = self.objects._replace(center=center, size=size, label=seen.label)
            remembered, _ = episodes.reward.step(
                self.reward_parameters, remembered, _State(objects), active
            )
        return Seen(memory, remembered, seen.label)

    @checked
    def act(self, seen: Seen, observation: Float[Array, "O"]) -> Float[Array, "A"]:
        """The deterministic action, in [-1, 1], for the task's own observation.

        Raises:
          ShapeError: the observation is of another size than the task's.
        """
        _require("observation", observation.shape, (self.observation_size,))
        state = _State(self.objects, observation)
        episode = EpisodeState(state, seen.memory, seen.remembered, jnp.zeros((), jnp.int32))
        key = jax.random.key(0)  # which a deterministic action does not read
        return self.algorithm.act(self.parameters, episode, key, deterministic=True)


def _require(name: str, found: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    if found != wanted:
        raise ShapeError(f"{name} has shape {found}, but the policy's task has {wanted}.")
