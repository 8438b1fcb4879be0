"""Vectors of the plane as two arrays, one for each component.

Kept apart, the components of many vectors are long, dense arrays that XLA runs through at full
width; an axis of length two at the end would leave most of a processor's lanes empty.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Vec:
    """Vectors (x, y), or rotations (cosine, sine); leading axes broadcast."""

    x: ArrayLike
    y: ArrayLike

    def __add__(self, other: "Vec") -> "Vec":
        return Vec(self.x + other.x, self.y + other.y)

    def __sub__(self, other: "Vec") -> "Vec":
        return Vec(self.x - other.x, self.y - other.y)

    def __neg__(self) -> "Vec":
        return Vec(-self.x, -self.y)

    def __mul__(self, scale) -> "Vec":
        return Vec(self.x * scale, self.y * scale)

    def __getitem__(self, index) -> "Vec":
        return Vec(self.x[index], self.y[index])

    def dot(self, other: "Vec") -> Array:
        """Scalar product."""
        return self.x * other.x + self.y * other.y

    def cross(self, other: "Vec") -> Array:
        """The z component of the vector product."""
        return self.x * other.y - self.y * other.x

    def turned(self) -> "Vec":
        """Rotates by a quarter turn counter-clockwise."""
        return Vec(-self.y, self.x)

    def out_of(self, frame: "Vec") -> "Vec":
        """Rotates from a frame turned by (cosine, sine) into the world's."""
        return Vec(frame.x * self.x - frame.y * self.y, frame.y * self.x + frame.x * self.y)

    def into(self, frame: "Vec") -> "Vec":
        """Rotates from the world's frame into one turned by (cosine, sine)."""
        return Vec(frame.x * self.x + frame.y * self.y, frame.x * self.y - frame.y * self.x)


def heading(angle: Float[Array, "..."]) -> Vec:
    """The rotation (cosine, sine) by an angle in rad."""
    return Vec(jnp.cos(angle), jnp.sin(angle))


def fence(tree):
    """The same arrays, fenced so that XLA computes no part of them twice.

    On a CPU, XLA folds cheap operations into each of their users, which here would repeat a whole
    search for every field of its result, and a sweep's first contacts for each of its last: 5 times
    slower. It does not fold past a concatenation that it cannot take apart again, such as this one
    of padded rows. On a GPU, XLA chooses well, and the copies would cost a third of the speed.
    """
    return jax.lax.platform_dependent(tree, cpu=_concatenated, default=lambda same: same)


def _concatenated(tree):
    leaves, structure = jax.tree.flatten(tree)
    most = max(leaf.size for leaf in leaves) + 1
    rows = [jnp.concatenate([f.reshape(-1), jnp.zeros(most - f.size)]) for f in leaves]
    table = jnp.stack(rows)
    pieces = [table[k, : leaf.size].reshape(leaf.shape) for k, leaf in enumerate(leaves)]
    return jax.tree.unflatten(structure, pieces)


def where(condition: Array, a: Vec, b: Vec) -> Vec:
    """Elementwise choice."""
    return Vec(jnp.where(condition, a.x, b.x), jnp.where(condition, a.y, b.y))
