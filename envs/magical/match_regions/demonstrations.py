"""Demonstrations of MatchRegions."""

from collections.abc import Callable

from gril_jax.envs.base import Demonstrations, Wanted
from gril_jax.envs.magical.expert.demonstrations import record

from .expert.plans import FAILURES
from .expert.scripted import rollout
from .task import MatchRegions


def demonstrate(
    make: Callable[..., MatchRegions], wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """The demonstrations wanted; a `gril_jax.envs.base.Demonstrate`.

    The gripper demonstrates, whichever robot will learn: the reward does not see the robot.
    """
    env = make(robot="gripper", observation="rich", variant=wanted.places)
    env.episode_length = env.episode_length * 4 // 3  # the expert is slower than a policy
    play = lambda key, kind: rollout(env, key, kind)[0]  # noqa: E731
    return record(env, play, len(FAILURES), wanted, tell)
