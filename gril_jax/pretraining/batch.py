"""Training batches of an encoder: choice of videos and frames, augmentation, and displaced copies.

Copies of frames with displaced objects are states that no demonstration visits. Shapes use B for
demonstrations, V for the videos of a batch, F for the frames sampled from each and N for objects.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.config.encoder import EncoderOptions
from gril_jax.types import DemoBatch

from .arrangement import Arrangement
from .final_places import FinalPlaces
from .options import PixelStatic

# How likely a displaced object goes where: anywhere, back to its start, to the last place of
# another object, a little way off, around the object that its class refers to, to an edge of it.
_PLACES = (0.2, 0.06, 0.1, 0.1, 0.19, 0.35)
_ACROSS = 0.9  # halves of a box, standard deviation of its distance from that edge
_ALONG = 1.1  # halves of the reference's box, from the edge's middle each way
_NEARBY = 0.4  # of the encoder's length units, standard deviation
_AROUND = 0.8  # in sizes of the reference's box, each way
_TOUCHED = 0.2  # probability that a bit is set of an object that has not been displaced
# Where ends are arrangements: how likely an object goes beside another one, and all that moves goes
# as one; how far centres beside each other are apart, in boxes.
_BESIDE, _AS_ONE = 0.4, 0.25
_APART = 0.7, 2.5
# There a copy may show another layout, in which things lay from the beginning: no bit is set by it,
# what holds others has another size (factors of its sides), and takes along what lies in it.
_ELSEWHERE, _TAKEN_ALONG = 0.5, 0.5
_SIZES = 0.7, 1.5
# There half of the copies lack some of what no demonstration moves, and some of the rest is of the
# class of another object.
_LACKING, _OTHER_CLASS = 0.5, 0.15

Ends = FinalPlaces | Arrangement  # what counts as done


def draw(
    key: PRNGKeyArray, length: Int[Array, "B"], num_frames: int, config: PixelStatic
) -> tuple[Int[Array, "V F"], Bool[Array, "V F"], Int[Array, "V"]]:
    """Samples distinct videos, and distinct frames of each in order of time.

    A video shorter than the number of frames gives all it has; the rest is not valid.
    """
    video_key, frame_key = jax.random.split(key)
    videos = jax.random.choice(video_key, len(length), (config.num_videos,), replace=False)
    limit = length[videos, None]
    noise = jax.random.uniform(frame_key, (config.num_videos, num_frames))
    noise = jnp.where(jnp.arange(num_frames) < limit, noise, -1.0)  # padding is sampled last
    _, frames = jax.lax.top_k(noise, min(config.num_frames, num_frames))
    frames = jnp.sort(frames, axis=-1)
    return frames, frames < limit, videos


def turn(key: PRNGKeyArray, demos: DemoBatch) -> DemoBatch:
    """Applies a random symmetry of the square to each video; activity bits do not change."""
    sign_key, swap_key = jax.random.split(key)
    num = demos.length.shape[0]
    sign = jax.random.rademacher(sign_key, (num, 1, 1, 2), dtype=jnp.float32)
    swap = jax.random.bernoulli(swap_key, shape=(num, 1, 1, 1))
    center, size = (jnp.where(swap, x[..., ::-1], x) for x in (demos.center, demos.size))
    return demos._replace(center=center * sign, size=size)


def touch(
    key: PRNGKeyArray, active: Bool[Array, "V T N"], probability: Float[Array, ""] | float
) -> Bool[Array, "V T N"]:
    """Sets the activity bits of some objects from the first frame to the last."""
    some = jax.random.bernoulli(key, probability, active[:, 0].shape)
    return active | some[:, None]


def rewound(
    key: PRNGKeyArray,
    frames: Int[Array, "V F"],
    valid: Bool[Array, "V F"],
    probability: Float[Array, ""] | float,
) -> Int[Array, "V F"]:
    """Some videos play up to a frame of the second half, then as far back as frames are left.

    Rewinding of ReWiND (arXiv 2505.10911): o_1, ..., o_i, o_(i-1), ..., o_(i-k). Padding stays.
    """
    some_key, turn_key = jax.random.split(key)
    count = jnp.sum(valid, axis=1)[:, None]
    some = jax.random.bernoulli(some_key, probability, count.shape)
    turn = jax.random.randint(turn_key, count.shape, count // 2, jnp.maximum(count, 1))
    place = jnp.arange(frames.shape[1])
    back = some & valid & (place > turn)
    return jnp.take_along_axis(frames, jnp.where(back, 2 * turn - place, place), axis=1)


class Copy(NamedTuple):
    """A frame with displaced objects."""

    center: Float[Array, "N 2"]
    size: Float[Array, "N 2"]
    active: Bool[Array, "N"]
    moved: Bool[Array, "N"]  # what has been displaced


def displaced(
    key: PRNGKeyArray,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    active: Bool[Array, "N"],
    demo: DemoBatch,
    places: Ends,
    extent: Float[Array, ""] | float,
    length_unit: float = EncoderOptions.length_unit,
) -> Copy:
    """One copy of a frame; each object is displaced with a probability that is sampled per copy.

    The frame is of the video `demo`; it stays within |x|, |y| <= `extent`, world units, and
    `length_unit` is that of the encoder. The key is consumed.
    """
    keys = jax.random.split(key, 8)
    num = center.shape[0]
    movable = demo.present & ~demo.is_robot
    chosen = movable & jax.random.bernoulli(keys[0], jax.random.uniform(keys[1]), (num,))

    first, last = demo.center[0], demo.center[demo.length - 1]
    anywhere = jax.random.uniform(keys[2], (num, 2), minval=-extent, maxval=extent)
    others = jnp.where(movable & ~jnp.eye(num, dtype=bool), 0.0, -1e9)
    swapped = last[jax.random.categorical(keys[3], others)]
    nearby = center + _NEARBY * length_unit * jax.random.normal(keys[4], (num, 2))
    is_reference = demo.label[None, :] == places.reference[demo.label][:, None]
    at = jnp.argmax(is_reference, axis=1)
    aside = jax.random.uniform(keys[5], (num, 2), minval=-_AROUND, maxval=_AROUND)
    around = center[at] + size[at] * aside
    edge = _at_edge(jax.random.fold_in(key, 9), center[at], size[at], size)
    if isinstance(places, Arrangement):  # the edges of what moves are none of a place
        holds = places.bonds.container[places.reference][demo.label]
        edge = jnp.where(holds[:, None], edge, anywhere)
    which = jax.random.choice(keys[6], len(_PLACES), (num, 1), p=jnp.array(_PLACES))
    options = [anywhere, first, swapped, nearby, around, edge]
    place = jnp.select([which == i for i in range(len(options))], options)
    place = jnp.clip(place, -extent, extent)
    touched = movable & jax.random.bernoulli(keys[7], _TOUCHED, (num,))
    if not isinstance(places, Arrangement):
        place = jnp.where(chosen[:, None], place, center)
        return Copy(place, size, active | chosen | touched, chosen)
    key_beside, key_as_one, key_layout = jax.random.split(jax.random.fold_in(key, 8), 3)
    place = _beside(key_beside, place, center, size, others, extent)
    as_one, moved = _as_one(key_as_one, center, movable & places.moves[demo.label], extent)
    place, chosen = jnp.where(as_one[:, None], moved, place), chosen | as_one
    holds = movable & places.bonds.container[demo.label]
    before = Copy(center, size, active | touched, chosen)
    place = jnp.where(chosen[:, None], place, center)
    return _in_other_layouts(key_layout, before, place, movable, holds, extent)


def other_things(
    key: PRNGKeyArray, demo: DemoBatch, places: Ends
) -> tuple[Int[Array, "N"], Bool[Array, "N"]]:
    """Labels of a copy's objects, and which of them are there: other scenes hold other things.

    Only what no demonstration moves is exchanged or left out, and holds nothing. Where ends are
    places of classes everything stays as it is. The key is consumed.
    """
    if not isinstance(places, Arrangement):
        return demo.label, demo.present
    keys = jax.random.split(key, 5)
    solid = demo.present & ~demo.is_robot & ~places.bonds.container[demo.label]
    rests = solid & places.rests[demo.label]
    some = jax.random.bernoulli(keys[0], _LACKING)
    gone = some & jax.random.bernoulli(keys[1], jax.random.uniform(keys[2]), rests.shape)
    other = jax.random.categorical(keys[3], jnp.where(solid, 0.0, -1e9), shape=rests.shape)
    changed = rests & jax.random.bernoulli(keys[4], _OTHER_CLASS, rests.shape)
    return jnp.where(changed, demo.label[other], demo.label), demo.present & ~(rests & gone)


def _at_edge(key: PRNGKeyArray, center, sides, size) -> Float[Array, "N 2"]:
    """Places near an edge of boxes with these centres and sides, for boxes of a size."""
    keys = jax.random.split(key, 4)
    num = len(center)
    along = center + _ALONG * sides / 2 * jax.random.uniform(keys[0], (num, 2), minval=-1.0)
    side = jax.random.rademacher(keys[1], (num, 1), dtype=center.dtype)
    off = _ACROSS * size / 2 * jax.random.normal(keys[2], (num, 1))
    across = center + side * (sides / 2 + off)
    upright = jax.random.bernoulli(keys[3], 0.5, (num,))
    return jnp.where(jnp.stack([upright, ~upright], axis=1), across, along)


def _in_other_layouts(key: PRNGKeyArray, frame: Copy, place, movable, holds, extent) -> Copy:
    """The copy whose `chosen` objects lie at the places; in some copies they always have."""
    keys = jax.random.split(key, 4)
    elsewhere = jax.random.bernoulli(keys[0], _ELSEWHERE)
    factor = jax.random.uniform(keys[1], place.shape, minval=_SIZES[0], maxval=_SIZES[1])
    factor = jnp.where(elsewhere & holds[:, None], factor, 1.0)
    beyond = (jnp.abs(frame.center[:, None] - frame.center) - frame.size / 2).max(axis=-1)
    beyond = jnp.where(holds & ~jnp.eye(len(holds), dtype=bool), beyond, jnp.inf)
    within = jnp.argmin(beyond, axis=1)
    along = elsewhere & jax.random.bernoulli(keys[2], _TAKEN_ALONG) & movable & ~holds
    along &= frame.moved[within] & (beyond.min(axis=1) <= 0)
    mirror = jax.random.rademacher(keys[3], (2,), dtype=place.dtype)
    offset = (frame.center - frame.center[within]) * factor[within] * mirror
    place = jnp.where(along[:, None], place[within] + offset, place)
    place = jnp.clip(place, -extent, extent)
    bits = frame.active | (frame.moved & ~holds & ~elsewhere)
    return Copy(place, frame.size * factor, bits, frame.moved | along)


def _beside(key: PRNGKeyArray, place, center, size, others, extent) -> Float[Array, "N 2"]:
    """The places, of which some lie beside another object instead."""
    keys = jax.random.split(key, 4)
    num = len(center)
    other = jax.random.categorical(keys[0], others)
    turn = jax.random.uniform(keys[1], (num, 1), maxval=2 * jnp.pi)
    apart = jax.random.uniform(keys[2], (num, 1), minval=_APART[0], maxval=_APART[1])
    way = jnp.concatenate([jnp.cos(turn), jnp.sin(turn)], axis=1)
    beside = center[other] + apart * size.mean(axis=1, keepdims=True) * way
    wanted = jax.random.bernoulli(keys[3], _BESIDE, (num, 1))
    return jnp.where(wanted, jnp.clip(beside, -extent, extent), place)


def _as_one(key: PRNGKeyArray, center, moving, extent):
    """True for some copies, of all that is moving; and it turned, mirrored and moved as one."""
    keys = jax.random.split(key, 4)
    count = jnp.maximum(moving.sum(), 1).astype(center.dtype)
    middle = jnp.sum(jnp.where(moving[:, None], center, 0.0), axis=0) / count
    angle = jax.random.uniform(keys[0], (), maxval=2 * jnp.pi)
    mirror = jax.random.rademacher(keys[1], (), dtype=center.dtype)
    c, s = jnp.cos(angle), jnp.sin(angle)
    turn = jnp.array([[c, -mirror * s], [s, mirror * c]])
    turned = (center - middle) @ turn
    # Within the arena where it fits, so that nothing is pressed together.
    low, high = (f(jnp.where(moving[:, None], turned, 0.0), axis=0) for f in (jnp.min, jnp.max))
    unit = jax.random.uniform(keys[2], (2,))
    room = jnp.maximum(2 * extent - (high - low), 0.0)
    there = turned + (-extent - low + unit * room)
    wanted = moving & jax.random.bernoulli(keys[3], _AS_ONE)
    return wanted, jnp.where(wanted[:, None], there, center)
