"""Frames of demonstrations beside copies in which objects are where nobody put them.

Cycle-consistency and reconstruction say nothing about states that no demonstration visits, and a
policy will find among them those that happen to lie near the goal. Here the reward of made-up
states is given, too: a copy of a frame in which objects that had come to rest are somewhere else
is worth less than the frame, by how far they are out of place (`gril_jax.final_places`). With K
objects that a video moves, each of them costs 1 / K when it is `reach` or more away from every
place where some video leaves it, and the root of its share of that when it is nearer; what the
video never moves costs `idle_cost` of it. Videos are all it takes: no action, no label.

An object is at rest in a frame if it is where the video leaves it. Only such objects are displaced,
so that no copy can be further on than its frame. Shapes use V for videos, N for objects, A for the
frames of a video that are copied and J for the copies of each.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from . import encoder
from .encoder import Params
from .final_places import FinalPlaces, has_moved, out_of_place
from .graphs import safe_norm, scene_graph
from .pretrain_options import Hyper, PretrainConfig
from .types import DemoBatch

__all__ = ["Copy", "Journey", "contrast", "displaced", "journey"]

_REST = 0.05  # in box diagonals: nearer than this to its last place, an object is at rest
# How likely a displaced object goes where: anywhere, back to its start, to the place of another
# object, or a little way off.
_PLACES = (0.4, 0.2, 0.2, 0.2)
_NEARBY = 0.4  # world units, standard deviation
_MORE = 0.3  # probability of each further object
_TOUCHED = 0.2  # probability that a bit is set of an object that has not been displaced


class Journey(NamedTuple):
    """What a video does to its objects."""

    first: Float[Array, "N 2"]
    last: Float[Array, "N 2"]
    cost: Float[Array, "N"]  # what an object costs at most
    movable: Bool[Array, "N"]  # what may be displaced: not the robot, not padding


class Copy(NamedTuple):
    """A frame with objects displaced."""

    center: Float[Array, "N 2"]
    active: Bool[Array, "N"]
    resting: Bool[Array, "N"]  # what had come to rest in the frame


def journey(
    first: Float[Array, "N 2"],
    last: Float[Array, "N 2"],
    diagonal: Float[Array, "N"],
    movable: Bool[Array, "N"],
    *,
    idle_cost: Float[Array, ""] | float,
) -> Journey:
    """Costs of displacing the objects of a video.

    Args:
      first, last: centres in its first and last frames.
      diagonal: of the objects' boxes.
      movable: objects that may be displaced.
      idle_cost: of an object that the video does not move, as a share of one that it does.
    """
    moved = movable & has_moved(first, last, diagonal)
    count = jnp.maximum(jnp.sum(moved), 1)
    cost = jnp.where(moved, 1.0, idle_cost) / count
    return Journey(first, last, jnp.where(movable, cost, 0.0), movable)


def displaced(
    key: PRNGKeyArray,
    center: Float[Array, "N 2"],
    diagonal: Float[Array, "N"],
    active: Bool[Array, "N"],
    of: Journey,
    extent: Float[Array, ""] | float,
) -> Copy:
    """One copy of a frame with at least one object at rest displaced, if there is any.

    Args:
      key: consumed.
      center, diagonal, active: the frame's.
      of: the video's.
      extent: places lie within |x|, |y| <= this, world units.
    """
    keys = jax.random.split(key, 7)
    num = center.shape[0]
    resting = of.movable & (safe_norm(center - of.last) <= _REST * diagonal)
    one = jnp.arange(num) == jax.random.categorical(keys[0], jnp.where(resting, 0.0, -1e9))
    chosen = resting & (one | jax.random.bernoulli(keys[1], _MORE, (num,)))

    anywhere = jax.random.uniform(keys[2], (num, 2), minval=-extent, maxval=extent)
    others = jnp.where(of.movable & ~jnp.eye(num, dtype=bool), 0.0, -1e9)
    swapped = of.last[jax.random.categorical(keys[3], others)]
    nearby = center + _NEARBY * jax.random.normal(keys[4], (num, 2))
    which = jax.random.choice(keys[5], len(_PLACES), (num, 1), p=jnp.array(_PLACES))
    places = [anywhere, of.first, swapped, jnp.clip(nearby, -extent, extent)]
    place = jnp.select([which == i for i in range(len(places))], places)

    return Copy(
        center=jnp.where(chosen[:, None], place, center),
        active=active | chosen | (of.movable & jax.random.bernoulli(keys[6], _TOUCHED, (num,))),
        resting=resting,
    )


def contrast(
    params: Params,
    key: PRNGKeyArray,
    demos: DemoBatch,
    active: Bool[Array, "V T N"],
    places: FinalPlaces,
    hyper: Hyper,
    config: PretrainConfig,
) -> Float[Array, ""]:
    """Mean squared errors of the rewards of copies, of last frames (0) and of first frames (-1).

    The reward (Eq. 7) has the mean of the batch's last latents as its goal, and `hyper.span` as the
    latent distance of a reward of -1; were that measured in the batch, a smaller latent space would
    look like a better one. Of each video the last frame is copied `config.anchors` / 2 times, and
    as many frames at random times; of those the reward itself is taken as it is.

    Args:
      params: of the encoder.
      key: consumed.
      demos: the batch's videos.
      active: their activity bits.
      places: where all demonstrations leave objects.
      hyper: its `alpha`, `reach`, `idle_cost` and `span` are used.
      config: its `encoder`, `anchors` and `copies` are used.
    """
    movable = demos.present & ~demos.is_robot
    extent = jnp.max(jnp.abs(demos.center))
    ends = config.anchors // 2

    def encode(demo, center, size, bits):
        graph = scene_graph(center, size, demo.label, demo.is_robot, bits, demo.present)
        return encoder.apply(params, graph, config.encoder, alpha=hyper.alpha)

    def video(key, demo, bits, movable):
        key_frames, key_copies = jax.random.split(key)
        last = demo.length - 1
        drawn = jax.random.randint(key_frames, (config.anchors - ends,), 0, demo.length)
        frames = jnp.concatenate([jnp.full((ends,), last), drawn])
        of = journey(
            demo.center[0], demo.center[last], safe_norm(demo.size[last]), movable,
            idle_cost=hyper.idle_cost,
        )  # fmt: skip

        def anchor(key, frame):
            center, size = demo.center[frame], demo.size[frame]

            def copy(key):
                made = displaced(key, center, safe_norm(size), bits[frame], of, extent)
                astray = out_of_place(places, made.center, size, demo.label)
                share = jnp.sqrt(jnp.minimum(astray / hyper.reach, 1.0))
                cost = jnp.sum(jnp.where(made.resting, of.cost * share, 0.0))
                return encode(demo, made.center, size, made.active), cost

            copies = jax.vmap(copy)(jax.random.split(key, config.copies))
            return encode(demo, center, size, bits[frame]), *copies

        found = jax.vmap(anchor)(jax.random.split(key_copies, config.anchors), frames)
        return *found, encode(demo, demo.center[0], demo.size[0], bits[0])

    keys = jax.random.split(key, demos.length.shape[0])
    anchors, copies, cost, first = jax.vmap(video)(keys, demos, active, movable)
    goal = jnp.mean(anchors[:, 0], axis=0)  # the frame that is copied first is the last one
    distance = safe_norm(anchors - goal) / hyper.span  # (V, A)
    worth = jax.lax.stop_gradient(distance.at[:, :ends].set(0.0))
    error = safe_norm(copies - goal) / hyper.span - (worth[..., None] + cost)  # (V, A, J)
    first = safe_norm(first - goal) / hyper.span - 1.0
    return jnp.mean(error**2) + jnp.mean(distance[:, :ends] ** 2) + jnp.mean(first**2)
