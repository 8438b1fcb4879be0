"""Frames of demonstrations beside copies in which objects are where nobody put them.

Cycle-consistency and reconstruction say nothing about states that no demonstration visits, and a
policy will find among them those that happen to lie near the goal. Here the distance of made-up
states from the goal is given, too: copies of frames in which objects are somewhere else are as far
from it as `gril_jax.final_places.misplacement` says, which knows from the last frames of the
demonstrations what belongs where. Videos are all it takes: no action, no label.

With `ascents` the copies go where the present encoder overrates them most, before it learns from
them: the same that a policy would do (adversarial training, Madry et al., ICLR 2018).

Shapes use V for videos, N for objects, A for the frames of a video that are copied and J for the
copies of each.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from . import encoder
from .encoder import Params
from .final_places import FinalPlaces, misplacement
from .graphs import safe_norm, scene_graph
from .pretrain_options import Hyper, PretrainConfig
from .types import DemoBatch

__all__ = ["Copy", "contrast", "displaced"]

# How likely a displaced object goes where: anywhere, back to its start, to the last place of
# another object, a little way off, around the object that its class refers to.
_PLACES = (0.3, 0.1, 0.15, 0.15, 0.3)
_NEARBY = 0.4  # world units, standard deviation
_AROUND = 0.8  # in sizes of the reference's box, each way
_TOUCHED = 0.2  # probability that a bit is set of an object that has not been displaced
_ASCENT = 0.1  # world units: the first step of an ascent; the others get shorter


class Copy(NamedTuple):
    """A frame with objects displaced."""

    center: Float[Array, "N 2"]
    active: Bool[Array, "N"]
    moved: Bool[Array, "N"]  # what has been displaced


def displaced(
    key: PRNGKeyArray,
    center: Float[Array, "N 2"],
    size: Float[Array, "N 2"],
    active: Bool[Array, "N"],
    demo: DemoBatch,
    places: FinalPlaces,
    extent: Float[Array, ""] | float,
) -> Copy:
    """One copy of a frame; each object is displaced with a probability that the copy draws.

    Args:
      key: consumed.
      center, size, active: the frame's.
      demo: the video, without the leading axis.
      places: of all demonstrations.
      extent: places lie within |x|, |y| <= this, world units.
    """
    keys = jax.random.split(key, 8)
    num = center.shape[0]
    movable = demo.present & ~demo.is_robot
    chosen = movable & jax.random.bernoulli(keys[0], jax.random.uniform(keys[1]), (num,))

    first, last = demo.center[0], demo.center[demo.length - 1]
    anywhere = jax.random.uniform(keys[2], (num, 2), minval=-extent, maxval=extent)
    others = jnp.where(movable & ~jnp.eye(num, dtype=bool), 0.0, -1e9)
    swapped = last[jax.random.categorical(keys[3], others)]
    nearby = center + _NEARBY * jax.random.normal(keys[4], (num, 2))
    is_reference = demo.label[None, :] == places.reference[demo.label][:, None]
    at = jnp.argmax(is_reference, axis=1)
    around = center[at] + size[at] * jax.random.uniform(
        keys[5], (num, 2), minval=-_AROUND, maxval=_AROUND
    )
    which = jax.random.choice(keys[6], len(_PLACES), (num, 1), p=jnp.array(_PLACES))
    options = [anywhere, first, swapped, nearby, around]
    place = jnp.clip(jnp.select([which == i for i in range(5)], options), -extent, extent)
    touched = movable & jax.random.bernoulli(keys[7], _TOUCHED, (num,))
    return Copy(jnp.where(chosen[:, None], place, center), active | chosen | touched, chosen)


def contrast(
    params: Params,
    key: PRNGKeyArray,
    demos: DemoBatch,
    active: Bool[Array, "V T N"],
    places: FinalPlaces,
    hyper: Hyper,
    config: PretrainConfig,
) -> Float[Array, ""]:
    """Mean squared error of the rewards of copied frames, of their copies and of last frames (0).

    The reward (Eq. 7) has the mean of the batch's last latents as its goal, and `hyper.span` as the
    latent distance of a reward of -1; were that measured in the batch, a smaller latent space would
    look like a better one.

    Args:
      params: of the encoder.
      key: consumed.
      demos: the batch's videos.
      active: their activity bits.
      places: where all demonstrations leave objects.
      hyper: its `alpha`, `near`, `idle_cost`, `touch`, `tail` and `span` are used.
      config: its `encoder`, `anchors`, `copies` and `ascents` are used.
    """
    extent = jnp.max(jnp.abs(demos.center))

    def encode(params, demo, center, size, bits):
        graph = scene_graph(center, size, demo.label, demo.is_robot, bits, demo.present)
        return encoder.apply(params, graph, config.encoder, alpha=hyper.alpha)

    def final(demo, bits):
        at = demo.length - 1
        return encode(params, demo, demo.center[at], demo.size[at], bits[at])

    last = jax.vmap(final)(demos, active)
    goal = jnp.mean(last, axis=0)

    def excess(params, goal, demo, center, size, bits):
        """Latent distance beyond what is due."""
        due = misplacement(
            places, center, size, demo.label, demo.present & ~demo.is_robot, bits,
            near=hyper.near, idle_cost=hyper.idle_cost, touch=hyper.touch,
        )  # fmt: skip
        return safe_norm(encode(params, demo, center, size, bits) - goal) / hyper.span - due

    def ascended(demo, made, size):
        now = jax.lax.stop_gradient((params, goal))
        slope = jax.grad(lambda c: excess(*now, demo, c, size, made.active))
        center = made.center
        for length in jnp.geomspace(_ASCENT, _ASCENT / 4, config.ascents) if config.ascents else ():
            down = slope(center)
            step = length * down / jnp.maximum(safe_norm(down)[:, None], 1e-6)
            there = jnp.clip(center - step, -extent, extent)
            center = jnp.where(made.moved[:, None], there, center)
        return center

    def anchor(key, demo, bits):
        key_frame, key_copies = jax.random.split(key)
        at = jax.random.randint(key_frame, (), 0, demo.length)
        center, size = demo.center[at], demo.size[at]

        def copy(key):
            made = displaced(key, center, size, bits[at], demo, places, extent)
            return excess(params, goal, demo, ascended(demo, made, size), size, made.active)

        copies = jax.vmap(copy)(jax.random.split(key_copies, config.copies))
        return excess(params, goal, demo, center, size, bits[at]), copies

    def video(key, demo, bits):
        keys = jax.random.split(key, config.anchors)
        return jax.vmap(anchor, (0, None, None))(keys, demo, bits)

    plain, copies = jax.vmap(video)(jax.random.split(key, len(last)), demos, active)
    ends = safe_norm(last - goal) / hyper.span
    return sum(jnp.mean(_penalty(x, hyper.tail)) for x in (copies, plain, ends))


def _penalty(error, tail):
    """The square, and beyond errors of a tenth the fourth power: it is the worst that is found."""
    return error**2 * (1.0 + tail * (error / 0.1) ** 2)
