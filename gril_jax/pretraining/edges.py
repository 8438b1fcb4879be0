"""The side of an edge that a box is on, as a cost from 0 to 1.

A thing is in another one where its centre is. Videos show things well inside or well outside, and a
reward must tell the two sides of the edge apart: a policy stops where the reward ends. So a cost
rises within a few pixels of the edge, and is flat on both sides of it.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.encoders.graph_features import EDGE as WIDTH


def crossed(
    beyond: Float[Array, "*batch"], half: Float[Array, "*#batch"]
) -> Float[Array, "*batch"]:
    """0 where a centre is inside by `WIDTH` halves of its box, 1 where it is outside by as much.

    >>> crossed(jnp.array([-0.5, 0.0, 0.15, 0.5]), jnp.array([1.0])).tolist()
    [0.0, 0.5, 0.75, 1.0]

    `beyond` is the distance of the centre out of the edge, negative inside, and `half` is half the
    smaller side of the box; world units.
    """
    return jnp.clip(beyond / jnp.maximum(2 * WIDTH * half, 1e-6) + 0.5, 0.0, 1.0)
