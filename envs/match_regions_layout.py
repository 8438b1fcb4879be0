"""Where things stand at the start of a MatchRegions episode, drawn inside jit.

A layout is an array of poses (x, y, angle): robot first, then the blocks. Overlap is judged by
bounding circles, a little stricter than MAGICAL's exact test. Entities are placed one after
another; each takes the first of `_CANDIDATES` uniform poses that is free, or, if none is, the
freest one, so that a reset always ends.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

__all__ = ["DEMO_BLOCKS", "DEMO_GOAL", "DEMO_ROBOT", "jitter", "scatter"]

# MAGICAL's Demo layout: x, y (arena units) and angle (rad).
DEMO_ROBOT = (-0.5, 0.1, -1.2 * 3.141592653589793)
DEMO_BLOCKS = {
    "green star": (0.80, -0.70, 2.37),
    "green square": (-0.68, 0.72, 1.28),
    "blue pentagon": (-0.05, -0.20, -1.09),
    "yellow circle": (-0.75, -0.55, 2.78),
    "yellow pentagon": (0.30, -0.82, -1.15),
}
DEMO_GOAL = (0.40, 0.35, 0.60, 0.70)  # centre x, y; width, height
_CANDIDATES = 48


def jitter(
    key: PRNGKeyArray,
    poses: Float[Array, "E 3"],
    goal: Float[Array, "4"],
    *,
    arena: float,
) -> tuple[Float[Array, "E 3"], Float[Array, "4"]]:
    """MAGICAL's Jitter variant: every number moves a little, and no overlap can arise."""
    key_pose, key_goal = jax.random.split(key)
    spread = jnp.array([0.025 * arena, 0.025 * arena, 0.157])
    poses = poses + spread * jax.random.uniform(key_pose, poses.shape, minval=-1.0)
    spread = jnp.array([0.025 * arena, 0.025 * arena, 0.0075, 0.0075])
    return poses, goal + spread * jax.random.uniform(key_goal, (4,), minval=-1.0)


def _gap_to_goal(xy: Float[Array, "C 2"], goal: Float[Array, "4"]) -> Float[Array, "C"]:
    outside = jnp.maximum(jnp.abs(xy - goal[:2]) - goal[2:] / 2, 0.0)
    return jnp.sqrt(jnp.sum(outside**2, axis=1))


def place(
    key: PRNGKeyArray,
    radius: Float[Array, ""],
    poses: Float[Array, "E 3"],
    radii: Float[Array, "E"],
    goal: Float[Array, "4"],
    *,
    arena: float,
    clear_of_goal: bool = True,
) -> Float[Array, "3"]:
    """A free pose for a disc among others; entities with radius <= 0 do not count."""
    limit = arena - radius
    unit = jax.random.uniform(key, (_CANDIDATES, 3), minval=-1.0)
    pose = unit * jnp.stack([limit, limit, jnp.pi])
    apart = jnp.sqrt(jnp.sum((pose[:, None, :2] - poses[None, :, :2]) ** 2, axis=2))
    gap = jnp.where(radii > 0, apart - radii - radius, jnp.inf).min(axis=1)
    if clear_of_goal:
        gap = jnp.minimum(gap, _gap_to_goal(pose[:, :2], goal) - radius)
    free = gap > 0
    return pose[jnp.where(free.any(), jnp.argmax(free), jnp.argmax(gap))]


def scatter(
    key: PRNGKeyArray, radii: Float[Array, "E"], *, arena: float
) -> tuple[Float[Array, "E 3"], Float[Array, "4"]]:
    """MAGICAL's Layout variant: goal, then robot, then blocks, anywhere without overlap."""
    key_goal, *keys = jax.random.split(key, radii.shape[0] + 1)
    unit = jax.random.uniform(key_goal, (4,))
    size = 0.5 + 0.3 * unit[2:]
    goal = jnp.concatenate([(2 * unit[:2] - 1) * (arena - size / 2), size])
    poses, placed = jnp.zeros((radii.shape[0], 3)), jnp.zeros_like(radii)
    for i, key_i in enumerate(keys):
        pose = place(key_i, radii[i], poses, placed, goal, arena=arena)
        poses, placed = poses.at[i].set(pose), placed.at[i].set(radii[i])
    return poses, goal
