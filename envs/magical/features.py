"""What a policy sees of the robot, the same in all tasks. Lengths are in arena units."""

import jax.numpy as jnp
from gril_jax.envs.planar.joints import TURN_RATE
from gril_jax.envs.planar.robots import FINGER_OPEN
from jaxtyping import Array, Float

from .layout import turned


def robot(
    pose: Float[Array, "E 3"], velocity: Float[Array, "E 3"], parts: int
) -> list[Float[Array, "_"]]:
    """The numbers of `robot_names`, in parts; the first `parts` bodies are the robot's."""
    yaw = pose[0, 2]
    heading = jnp.stack([jnp.cos(yaw), jnp.sin(yaw)])
    speed = turned(-yaw, velocity[0, :2])[::-1]
    seen = [pose[0, :2], heading, speed, velocity[0, 2:] / TURN_RATE]
    if parts > 1:
        seen.append((pose[1:2, 2] - pose[2:3, 2]) / (2 * FINGER_OPEN))
    return seen


def robot_names(fingers: bool) -> dict[str, int]:
    """Each quantity, and how many numbers it has."""
    return {
        "robot position": 2, "robot heading, cosine and sine": 2,
        "robot speed, forward and sideways": 2, "robot turn rate / 2.5": 1,
        "finger opening": int(fingers),
    }  # fmt: skip
