"""Where demonstrations leave things, and how far out of place a thing is.

    known = final_places(demos)                                   # once for a set of demonstrations
    astray = out_of_place(known, center, size, label)             # (N,) world units, of any frame

An object is in place where, seen from a reference object, some demonstration left one of its class:
a block in the goal region, a shoe in the box, and whatever is not to be moved anywhere that such
things were. The reference of a class is found, not told: the class of things at rest from which its
final places differ least, in sizes of the reference's box, so that a large box serves as well as a
small one that stands in it. Shapes use B for demonstrations, N for objects, C for classes and M for
places.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .graphs import safe_norm
from .types import DemoBatch

__all__ = ["FinalPlaces", "final_places", "has_moved", "out_of_place"]


class FinalPlaces(NamedTuple):
    """Final places of each class, as offsets from its reference in sizes of the reference's box."""

    reference: Int[Array, "C"]
    offset: Float[Array, "C M 2"]
    known: Bool[Array, "C M"]


def has_moved(
    first: Float[Array, "*batch 2"],
    last: Float[Array, "*batch 2"],
    diagonal: Float[Array, "*batch"],
) -> Bool[Array, "*batch"]:
    """Whether a demonstration is about moving an object: from first to last frame by half its box.

    Args:
      first, last: its centres in these frames.
      diagonal: of its box.
    """
    return safe_norm(last - first) > 0.5 * diagonal


def final_places(demos: DemoBatch, num_classes: int, *, turned: bool = False) -> FinalPlaces:
    """The places in which demonstrations leave objects.

    Args:
      demos: successful ones.
      num_classes: C, that labels are less than.
      turned: whether scenes may be turned and mirrored: each place then counts as all of its eight
        images under the symmetries of the square, else as one.
    """
    last = demos.length[:, None, None, None] - 1
    center, size = (jnp.take_along_axis(x, last, axis=1)[:, 0] for x in (demos.center, demos.size))
    counts = demos.present & ~demos.is_robot
    moved = counts & has_moved(demos.center[:, 0], center, safe_norm(size))
    of_class = (demos.label[:, :, None] == jnp.arange(num_classes)) & counts[
        :, :, None
    ]  # (B, N, C)
    has = of_class.any(axis=1)  # (B, C)

    def mean(x):  # of the objects of each class: (B, C, ...)
        total = jnp.einsum("bnc,bnk->bck", of_class.astype(x.dtype), x)
        return total / jnp.maximum(of_class.sum(axis=1), 1)[..., None]

    place, box = mean(center), mean(size)
    box = jnp.where(has[..., None], jnp.maximum(box, 1e-6), 1.0)
    offset = (place[:, :, None] - place[:, None]) / box[:, None]  # (B, C, reference, 2)
    both = has[:, :, None] & has[:, None]
    seen = jnp.maximum(both.sum(axis=0), 1)
    middle = jnp.sum(jnp.where(both[..., None], offset, 0.0), axis=0) / seen[..., None]
    spread = jnp.where(both[..., None], (offset - middle) ** 2, 0.0).sum(axis=(0, 3)) / seen
    restless = (moved[:, :, None] & of_class).any(axis=1).sum(axis=0) * 2 > has.sum(axis=0)
    possible = both.any(axis=0) & ~restless & ~jnp.eye(num_classes, dtype=bool)
    # Of equal spreads, as in a single layout, the largest box is the better reference.
    mean_box = jnp.sum(jnp.where(has[..., None], box, 0.0), axis=(0, 2))
    spread = (spread + 1e-3) / jnp.maximum(mean_box, 1e-6)
    reference = jnp.argmin(jnp.where(possible, spread, jnp.inf), axis=1)

    chosen = jnp.take_along_axis(offset, reference[None, :, None, None], axis=2)[:, :, 0]
    known = jnp.take_along_axis(both & possible, reference[None, :, None], axis=2)[..., 0]
    chosen, known = jnp.swapaxes(chosen, 0, 1), known.T  # (C, B, ...)
    if turned:
        signs = jnp.array([[x, y] for x in (1.0, -1.0) for y in (1.0, -1.0)])
        images = [chosen * sign for sign in signs] + [chosen[..., ::-1] * sign for sign in signs]
        chosen, known = jnp.concatenate(images, axis=1), jnp.tile(known, (1, 8))
    return FinalPlaces(reference, chosen, known)


def out_of_place(
    places: FinalPlaces,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
) -> Float[Array, "N"]:
    """Distance of each object from the nearest place of its class, world units.

    0 for a class without known places, and where the scene lacks its reference.
    """
    wanted = places.reference[label]  # (N,)
    is_reference = label[None, :] == wanted[:, None]  # (N, N)
    at = jnp.argmax(is_reference, axis=1)
    offset = places.offset[label] * size[at][:, None]  # (N, M, 2)
    away = safe_norm(center[:, None] - center[at][:, None] - offset)
    nearest = jnp.min(jnp.where(places.known[label], away, jnp.inf), axis=1)
    found = is_reference.any(axis=1) & jnp.isfinite(nearest)
    return jnp.where(found, nearest, 0.0)
