"""Films of simulated episodes.

What a table holds is painted by MuJoCo, the arm included, where OpenGL works; everything else, and
everywhere else, as the outlines of the objects.
"""

import contextlib
from collections.abc import Sequence

import cv2
import jax
import numpy as np
from jaxtyping import UInt8

from gril_jax.demos.vision import render
from gril_jax.envs import Env, State
from gril_jax.envs.tabletop.environment import Tabletop
from gril_jax.envs.tabletop.render import Renderer

_PIXELS = 384


def episode(env: Env, states: State) -> UInt8[np.ndarray, "T P P 3"]:
    """Renders one episode, leaves (T, ...), as a film for people to watch."""
    states = jax.device_get(states)
    if not isinstance(env, Tabletop):
        return outlines(env, states.data)
    try:
        renderer = Renderer(env, _moments(states)[0], pixels=_PIXELS)
    except RuntimeError:  # no OpenGL
        return outlines(env, states.data)
    with contextlib.closing(renderer):
        places = zip(states.data.motion.qpos, states.data.fixtures, strict=True)
        frames = np.stack([renderer.frame(*moment) for moment in places])
    nothing = (frames == 0).all(axis=-1, keepdims=True)  # all that is there has some light
    return np.where(nothing, np.uint8(env.background), frames)


def with_captions(
    film: UInt8[np.ndarray, "T P P 3"], captions: Sequence[str]
) -> UInt8[np.ndarray, "T P P 3"]:
    """The film with a line of text in each frame, or as it is if there are none."""
    if not captions:
        return film
    film = np.ascontiguousarray(film)
    for frame, text in zip(film, captions, strict=True):
        for colour, width in (((255, 255, 255), 4), ((0, 0, 0), 1)):  # legible on any ground
            cv2.putText(frame, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, width,
                        cv2.LINE_AA)  # fmt: skip
    return film


def outlines(env: Env, data) -> UInt8[np.ndarray, "T P P 3"]:
    """Renders an episode from the objects' outlines; `data` is the simulator's, leaves (T, ...)."""
    look = {"half_extent": env.half_extent, "background": env.background}
    moments = _moments(jax.device_get(data))
    return np.stack([render.paint(env.outlines(moment), **look) for moment in moments])


def _moments(episode) -> list:
    length = jax.tree.leaves(episode)[0].shape[0]
    return [jax.tree.map(lambda x, t=t: x[t], episode) for t in range(length)]
