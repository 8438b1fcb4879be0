"""Ensembles: several networks of one kind as one encoder, scored by its most pessimistic member.

A policy finds the states that a network overestimates by accident. Networks with
different initial weights and batches agree where the demonstrations have been, but not elsewhere.
So the lowest of their rewards is harder to hack than any single one.

The members' latents lie side by side in one of size D = K x (a member's), and each member has a
scale of its own. Shapes use K for members and D for the latent of them all.
"""

import dataclasses
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.errors import ShapeError
from gril_jax.graphs.scene import safe_norm


def num_members(config: Any) -> int:
    """Number of networks in an encoder's config; 1 for kinds without ensembles."""
    return getattr(config, "ensemble_size", 1)


def latent_size(config: Any) -> int:
    """Size of an encoder's output: the members' latents side by side."""
    return num_members(config) * config.latent


def member(config: Any) -> Any:
    """The config of one member; for a single network, its own."""
    return config if num_members(config) == 1 else dataclasses.replace(config, ensemble_size=1)


def split(latent: Float[Array, "*batch D"], ensemble_size: int) -> Float[Array, "*batch K part"]:
    """Each member's part of a latent.

    >>> split(jnp.array([1.0, 2.0, 3.0, 4.0]), 2).tolist()
    [[1.0, 2.0], [3.0, 4.0]]

    Raises:
      ShapeError: the members cannot have equal parts.
    """
    *batch, size = latent.shape
    if ensemble_size < 1 or size % ensemble_size:
        raise ShapeError(
            f"a latent of size {size} does not belong to {ensemble_size} members; its size must be "
            "a multiple of their number."
        )
    return latent.reshape(*batch, ensemble_size, size // ensemble_size)


def worst_distance(
    difference: Float[Array, "*batch D"], scale: Float[Array, "*members"]
) -> Float[Array, "*batch"]:
    """Scaled length of a difference of latents; for an ensemble, of its largest part.

    With gradient zero, not NaN, where the difference is zero.

    >>> difference = jnp.array([3.0, 4.0, 0.0, 2.0])
    >>> worst_distance(difference, jnp.array([0.5, 2.0])).tolist()
    4.0

    Args:
      difference: of two latents.
      scale: () for a lone network; (K,) for the members of an ensemble.

    Raises:
      ShapeError: the difference is not of so many members.
    """
    if not scale.ndim:
        return scale * safe_norm(difference)
    return jnp.max(scale * safe_norm(split(difference, scale.shape[-1])), axis=-1)
