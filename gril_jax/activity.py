"""Which objects have moved since the episode began (Eq. 4 of the paper).

Object i becomes active at frame t if its centre lies more than tau box diagonals from where it
was k frames earlier, and stays active for the rest of the episode. Frames before the first
count as the first. The paper uses k = 40 and tau = 0.005.

`init` and `step` follow a rollout frame by frame; `trajectory` does a whole recording at once.
Both give the same bits. Shapes use N for objects, T for frames and K for the window. Goal and
robot get a bit like anything else: what it is worth is for `gril_jax.pooling` to say.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

__all__ = ["Memory", "init", "step", "trajectory"]


class Memory(NamedTuple):
    """What a rollout must remember, and must forget when an episode begins."""

    past: Float[Array, "K N 2"]  # centres of the last K frames, as a ring
    oldest: Int[Array, ""]  # the ring's slot that holds frame t - K
    active: Bool[Array, "N"]  # bits of the frame seen last


def init(center: Float[Array, "N 2"], *, window: int = 40) -> Memory:
    """Memory after an episode's first frame: nothing has moved.

    Args:
      center: box centres of the first frame, world units.
      window: k, how many frames back a centre is compared with; at least 1.
    """
    return Memory(
        past=jnp.broadcast_to(center, (window, *center.shape)),
        oldest=jnp.zeros((), jnp.int32),
        active=jnp.zeros(center.shape[0], bool),
    )


def step(
    memory: Memory,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    *,
    tau: Float[Array, ""] | float = 0.005,
) -> tuple[Memory, Bool[Array, "N"]]:
    """The next frame's activity bits.

    Args:
      memory: from `init` or the previous `step`.
      center: box centres of this frame, world units.
      size: box widths and heights of this frame, world units.
      tau: displacement that counts as motion, in diagonals of the object's own box.

    Returns:
      The memory for the next frame and this frame's bits.
    """
    active = memory.active | _moved(memory.past[memory.oldest], center, size, tau)
    memory = Memory(
        past=memory.past.at[memory.oldest].set(center),
        oldest=(memory.oldest + 1) % memory.past.shape[0],
        active=active,
    )
    return memory, active


def trajectory(
    center: Float[Array, "T N 2"],
    size: Float[Array, "T N 2"],
    *,
    tau: Float[Array, ""] | float = 0.005,
    window: int = 40,
) -> Bool[Array, "T N"]:
    """The activity bits of every frame of one recording; all False in the first."""
    earlier = jnp.maximum(jnp.arange(center.shape[0]) - window, 0)
    moved = _moved(center[earlier], center, size, tau)
    return jax.lax.cummax(moved.astype(jnp.int32), axis=0).astype(bool)


def _moved(
    before: Float[Array, "*frames N 2"],
    center: Float[Array, "*frames N 2"],
    size: Float[Array, "*frames N 2"],
    tau: Float[Array, ""] | float,
) -> Bool[Array, "*frames N"]:
    # Squares on both sides: no square root to round, and the two forms agree to the bit.
    displacement = jnp.sum(jnp.square(center - before), axis=-1)
    return displacement > tau**2 * jnp.sum(jnp.square(size), axis=-1)
