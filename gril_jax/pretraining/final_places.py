"""Final places of objects in demonstrations, and a scene's distance from them.

    places = final_places(demos, num_classes)             # once for a set of demonstrations
    cost = misplacement(places, center, size, label, counted, active)   # of any frame

An object that most demonstrations move has a final place: a block in the goal region, a shoe in the
box. Relative to a reference object, in sizes of that object's box, these ends fill a box. An object
of the class is in place within it. The reference is learned: it is the class of resting things from
which the ends differ least. An object that demonstrations do not move may lie anywhere but in such
a box, unless some of them left it there. No actions or labels are needed, but each demonstration
must end with the task done.

Shapes use B for demonstrations, N for objects and C for classes; lengths are world units.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from gril_jax.config.reward import LossConfig
from gril_jax.graphs.scene import safe_norm
from gril_jax.types import DemoBatch

from .edges import crossed

_INTO = 0.9  # share of the ends in a thing's box from which on it is what they are brought into
_STRAY = 0.05  # a class of which more than this share of ends lies in a box is no intruder
_NOWHERE = -1e3  # depth in a box that the scene lacks, world units


class FinalPlaces(NamedTuple):
    """Box of the final places of each class, as offsets from its reference in sizes of its box."""

    reference: Int[Array, "C"]
    low: Float[Array, "C 2"]
    high: Float[Array, "C 2"]
    placed: Bool[Array, "C"]  # demonstrations move it, and it has a reference
    intruder: Bool[Array, "C"]  # demonstrations leave it alone, and outside of those boxes
    journey: Float[Array, ""]  # mean distance from place at the start, of what is placed
    within: Bool[Array, "C"]  # in place anywhere in its reference's box, which is then its own


def has_moved(
    first: Float[Array, "*batch 2"],
    last: Float[Array, "*batch 2"],
    diagonal: Float[Array, "*batch"],
) -> Bool[Array, "*batch"]:
    """True if a demonstration moves an object, from first to last frame, by more than half its box.

    >>> has_moved(jnp.zeros(2), jnp.array([0.3, 0.4]), jnp.float32(0.9)).item()
    True

    `first` and `last` are its centres there, `diagonal` is that of its box.
    """
    return safe_norm(last - first) > 0.5 * diagonal


def final_places(
    demos: DemoBatch,
    num_classes: int,
    *,
    turned: bool = False,
    anywhere_inside: bool = False,
    trim_quantile: float = LossConfig.trim_quantile,
) -> FinalPlaces:
    """Computes the places in which successful demonstrations leave objects.

    A box leaves out the share `trim_quantile` of the ends on each side: mishaps and overhangs.

    With `turned`, scenes may be turned and mirrored: a box then has the square's symmetries. With
    `anywhere_inside`, a box that lies within its reference's is extended to all of that one.
    Demonstrations that bring a block well into a region do not show how far in it has to be.
    """
    at_end = demos.length[:, None, None, None] - 1
    boxes = (demos.center, demos.size)
    center, size = (jnp.take_along_axis(x, at_end, axis=1)[:, 0] for x in boxes)
    counted = demos.present & ~demos.is_robot
    moved = counted & has_moved(demos.center[:, 0], center, safe_norm(size))
    of_class = (demos.label[:, :, None] == jnp.arange(num_classes)) & counted[:, :, None]
    has = of_class.any(axis=1)  # (B, C)
    moves = (moved[:, :, None] & of_class).any(axis=1).sum(axis=0) * 2 > has.sum(axis=0)

    place, box = _class_mean(center, of_class), _class_mean(size, of_class)
    box = jnp.where(has[..., None], jnp.maximum(box, 1e-6), 1.0)
    offset = (place[:, :, None] - place[:, None]) / box[:, None]  # (B, C, reference, 2)
    both = has[:, :, None] & has[:, None]
    reference, found = _references(offset, both, box, has, moves)
    chosen = jnp.take_along_axis(offset, reference[None, :, None, None], axis=2)[:, :, 0]
    known = jnp.take_along_axis(both, reference[None, :, None], axis=2)[..., 0]  # (B, C)
    low, high = _box(chosen, known, turned, trim_quantile)
    within = anywhere_inside & moves & found & ((low >= -0.5) & (high <= 0.5)).all(axis=1)
    low, high = (jnp.where(within[:, None], side, x) for side, x in ((-0.5, low), (0.5, high)))

    places = FinalPlaces(reference, low, high, moves & found, ~moves, jnp.ones(()), within)
    inside = jax.vmap(intrusion, (None, 0, 0, 0))(places, center, size, demos.label) > 0
    entered = (inside[..., None] & of_class).sum(axis=(0, 1)).astype(low.dtype)
    often = entered > _STRAY * of_class.sum(axis=(0, 1)).astype(low.dtype)
    begin = demos.center[:, 0], demos.size[:, 0], demos.label
    begin = jax.vmap(astray, (None, 0, 0, 0))(places, *begin)
    due = counted & places.placed[demos.label]
    journey = jnp.sum(jnp.where(due, begin, 0.0)) / jnp.maximum(jnp.sum(due), 1).astype(low.dtype)
    return places._replace(intruder=~moves & ~often, journey=jnp.maximum(journey, 1e-3))


def astray(
    places: FinalPlaces,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
) -> Float[Array, "N"]:
    """Distance of each object of a scene from the box of its class.

    0 for what is not placed, and where the scene lacks its reference.
    """
    low, high, found = (x[label] for x in _boxes(places, center, size, label))
    return jnp.where(found, safe_norm(center - jnp.clip(center, low, high)), 0.0)


def intrusion(
    places: FinalPlaces,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
) -> Float[Array, "N"]:
    """Depth of each object that does not belong there inside the box of a class; else 0."""
    return jnp.maximum(_depth(places, center, size, label), 0.0)


def _depth(places, center, size, label):
    """Depth (N,) of each object that does not belong there in the box of a class; negative outside
    of all of them."""
    low, high, found = _boxes(places, center, size, label)
    inwards = jnp.minimum(center[:, None] - low, high - center[:, None])  # (N, C, 2)
    depth = jnp.where(found, inwards.min(axis=2), _NOWHERE).max(axis=1)
    return jnp.where(places.intruder[label], depth, _NOWHERE)


def crowding(
    places: FinalPlaces,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
    *,
    clearance_radius: float,
) -> Float[Array, "N"]:
    """Nearness of each object that does not belong there to the box of a class: 1 in it, 0 from
    `clearance_radius` halves of its own box away on. A box's own reference does not crowd it."""
    low, high, found = _boxes(places, center, size, label)
    away = safe_norm(center[:, None] - jnp.clip(center[:, None], low, high))  # (N, C)
    half = jnp.maximum(safe_norm(size) / 2, 1e-6)[:, None]
    near = jnp.clip(1.0 - away / (clearance_radius * half), 0.0, 1.0)
    own = label[:, None] == places.reference
    near = jnp.where(found & ~own, near, 0.0).max(axis=1)
    return jnp.where(places.intruder[label], near, 0.0)


def misplacement(
    places: FinalPlaces,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    label: Int[Array, "N"],
    counted: Bool[Array, "N"],
    active: Bool[Array, "N"],
    *,
    near_cost_fraction: Float[Array, ""] | float = LossConfig.near_cost_fraction,
    intrusion_weight: Float[Array, ""] | float = LossConfig.intrusion_weight,
    touch: Float[Array, ""] | float = LossConfig.touch,
    clearance_radius: float = LossConfig.clearance_radius,
) -> Float[Array, ""]:
    """Cost of a scene relative to the demonstrations' ends: 0 at an end, about 1 at a beginning.

    Each of K objects that are to be placed costs 1 / K at the mean distance at which
    demonstrations begin. The fraction `near_cost_fraction` of it applies in full as soon as the
    object is out of place by half its own box. The rest grows in proportion to the distance.

    For an object that belongs anywhere in its reference's box, that fraction applies where its
    centre is out of that box, and for an intruder where its centre is in (`edges.crossed`). It is
    the same all along the edge, so an object in place never costs more than one out of it.

    Args:
      places: of the demonstrations.
      center, size, label: of the scene's objects.
      counted: those that are present and no robot.
      active: those that have moved since the beginning.
      near_cost_fraction: that fraction; an object that is almost in place is far from done.
      intrusion_weight: cost of an intruder, by the same rule, as a share of 1 / K.
      touch: share of an object's cost that disappears once it has been moved at all.
      clearance_radius: above 0, an intruder costs in proportion to `crowding` at this distance
        instead.
    """
    half = jnp.maximum(safe_norm(size) / 2, 1e-6)
    due = counted & places.placed[label]
    away = astray(places, center, size, label)
    out = jnp.minimum(away / half, 1.0)
    out = jnp.where(places.within[label], _out(places, center, size, label), out)
    cost = near_cost_fraction * out + (1.0 - near_cost_fraction) * away / places.journey
    cost = (1.0 - touch) * cost + jnp.where(active, 0.0, touch)
    if clearance_radius:
        amiss = crowding(places, center, size, label, clearance_radius=clearance_radius)
    else:
        amiss = crossed(-_depth(places, center, size, label), _half_side(size))
        amiss = jnp.where(places.intruder[label], 1.0 - amiss, 0.0)
    cost = jnp.where(due, cost, intrusion_weight * amiss)
    return jnp.sum(jnp.where(counted, cost, 0.0)) / jnp.maximum(jnp.sum(due), 1).astype(cost.dtype)


def _out(places, center, size, label):
    """Share of the near cost of centres at the edge of the box of their class."""
    low, high, found = (x[label] for x in _boxes(places, center, size, label))
    beyond = jnp.maximum(low - center, center - high).max(axis=1)
    return jnp.where(found, crossed(beyond, _half_side(size)), 0.0)


def _half_side(size):
    """Half the smaller side of each box."""
    return size.min(axis=1) / 2


def _class_mean(x, of_class):
    """Mean of (B, N, 2) over the objects of each class: (B, C, 2)."""
    total = jnp.einsum("bnc,bnk->bck", of_class.astype(x.dtype), x)
    return total / jnp.maximum(of_class.sum(axis=1), 1).astype(x.dtype)[..., None]


def _references(offset, both, box, has, moves):
    """Reference class of each class by offsets (B, C, reference, 2), and whether there is one."""
    seen = jnp.maximum(both.sum(axis=0), 1).astype(offset.dtype)
    middle = jnp.sum(jnp.where(both[..., None], offset, 0.0), axis=0) / seen[..., None]
    spread = jnp.where(both[..., None], (offset - middle) ** 2, 0.0).sum(axis=(0, 3)) / seen
    possible = both.any(axis=0) & ~moves & ~jnp.eye(len(moves), dtype=bool)
    # Of equal spreads, as in a single layout, the largest box is the better reference.
    side = (
        jnp.sum(jnp.where(has[..., None], box, 0.0), axis=0)
        / jnp.maximum(has.sum(axis=0), 1).astype(box.dtype)[:, None]
    )
    mean_box = jnp.sum(jnp.where(has[..., None], box, 0.0), axis=(0, 2))
    shares = (spread + 1e-3) / jnp.maximum(mean_box, 1e-6)
    best = jnp.argmin(jnp.where(possible, shares, jnp.inf), axis=1)
    # What demonstrations bring into one thing belongs there, even if it lies at about the same
    # share of a larger thing beside that, which turns with it.
    lengths = jnp.sqrt(spread) * jnp.sqrt(jnp.sum(side**2, axis=1))
    around = jnp.where(both, (jnp.abs(offset) <= 0.5).all(axis=-1), False).sum(axis=0)
    into = possible & (around >= _INTO * jnp.maximum(both.sum(axis=0), 1))
    inner = jnp.argmin(jnp.where(into, lengths, jnp.inf), axis=1)
    own = jnp.arange(len(moves))
    closer = into[own, inner] & (lengths[own, inner] < lengths[own, best])
    return jnp.where(closer, inner, best), possible.any(axis=1)


def _box(offset, known, turned, trim_quantile):
    """Box of the offsets (B, C, 2) of each class, without their trim_quantile."""
    offset = jnp.where(known[..., None], offset, jnp.nan)
    if turned:
        both_axes = jnp.concatenate([offset, offset[..., ::-1]])
        high = jnp.nanquantile(jnp.abs(both_axes), 1.0 - 2.0 * trim_quantile, axis=0)
        low = -high
    else:
        low, high = jnp.nanquantile(offset, jnp.array([trim_quantile, 1.0 - trim_quantile]), axis=0)
    return jnp.nan_to_num(low), jnp.nan_to_num(high)


def _boxes(places, center, size, label):
    """World boxes of the placed classes, (C, 2) each, and a mask of those that exist."""
    is_reference = label[None, :] == places.reference[:, None]  # (C, N)
    at = jnp.argmax(is_reference, axis=1)
    low, high = (center[at] + x * size[at] for x in (places.low, places.high))
    return low, high, places.placed & is_reference.any(axis=1)
