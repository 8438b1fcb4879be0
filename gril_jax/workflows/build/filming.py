"""Videos of simulated episodes.

What a table holds is painted by MuJoCo, the arm included, where OpenGL works; everything else, and
everywhere else, as the outlines of the objects.
"""

import contextlib
from collections.abc import Iterable, Sequence

import cv2
import jax
import numpy as np
from jaxtyping import UInt8

from gril_jax.envs import Env, State
from gril_jax.envs.tabletop.environment import Tabletop
from gril_jax.envs.tabletop.render import Renderer

_PIXELS = 384
_SHIFT = 6  # cv2 takes fixed-point coordinates: this many bits behind the point


def episode(env: Env, states: State) -> UInt8[np.ndarray, "T P P 3"]:
    """Renders one episode, leaves (T, ...), as a video for people to watch."""
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
    """The video with a line of text in each frame, or as it is if there are none."""
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
    return np.stack([paint(env.outlines(moment), **look) for moment in moments])


def _moments(episode) -> list:
    length = jax.tree.leaves(episode)[0].shape[0]
    return [jax.tree.map(lambda x, t=t: x[t], episode) for t in range(length)]


def _to_pixels(vertices: np.ndarray, half_extent: float, pixels: int) -> np.ndarray:
    """Maps world (x right, y up) to fixed-point pixels (x right, y down, centres at integers)."""
    scale = pixels / (2 * half_extent)
    xy = (np.asarray(vertices) * [1, -1] + half_extent) * scale - 0.5
    return np.round(xy * 2**_SHIFT).astype(np.int32)


def _dashes(vertices: np.ndarray, dash: float, width: float) -> list[np.ndarray]:
    """The closed outline cut into dashes with gaps of the same length, each shorter by the line's
    width, because cv2 rounds the ends of thick lines."""
    pieces = []
    for a, b in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        length = float(np.linalg.norm(b - a))
        for start in np.arange(0.0, length, 2 * dash):
            first, last = start + width / 2, min(start + dash, length) - width / 2
            if first < last:
                pieces.append(np.stack([a + (b - a) * first / length, a + (b - a) * last / length]))
    return pieces


def paint(
    outlines: Iterable, *, half_extent: float, background: tuple[int, int, int], pixels: int = 384
) -> UInt8[np.ndarray, "P P 3"]:
    """Paints outlines in order, with smooth edges.

    Widths of lines and dashes are in pixels of a square picture of 384, which shows the world as
    far as `half_extent` from its middle."""
    image = np.full((pixels, pixels, 3), background, np.uint8)
    zoom = pixels / 384
    for item in outlines:
        points = _to_pixels(item.vertices, half_extent, pixels)
        cv2.fillPoly(image, [points], item.fill, cv2.LINE_AA, _SHIFT)
        width = round(item.width * zoom)
        if item.rim is None or width == 0:  # too thin to see: it would only fatten the shape
            continue
        if item.dash:
            unit = 2 * half_extent / 384  # one pixel of the 384-pixel picture
            for piece in _dashes(np.asarray(item.vertices), item.dash * unit, item.width * unit):
                line = _to_pixels(piece, half_extent, pixels)
                cv2.polylines(image, [line], False, item.rim, width, cv2.LINE_AA, _SHIFT)
        else:
            cv2.polylines(image, [points], True, item.rim, width, cv2.LINE_AA, _SHIFT)
    return image
