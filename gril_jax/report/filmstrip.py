"""Frames of demonstrations with their boxes.

T is frames, N objects. Positions and sizes are in world units, with the origin in the middle of
a frame and y up; half_extent is half the width of the world that a frame shows.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gril_jax.demos.demo import Tracks

from .style import COLOURS, HALF, shortened, styled

_CLASS_COLOURS = {"goal": "#333333", "robot": "#8C3FA8"}
_SHIFT = 4  # cv2 takes fixed-point coordinates: this many bits behind the point
_COLUMNS = 4  # frames of each demonstration on a contact sheet
_LEGEND = 3  # names in a row
_ROW = 0.58  # inches: a demonstration's name and its frames' numbers


class Film(NamedTuple):
    """One demonstration to draw."""

    name: str
    frames: UInt8[np.ndarray, "T H W 3"]
    tracks: Tracks  # of the same T frames
    active: Bool[np.ndarray, "T N"] | None = None  # has moved; None: not known


@styled
def contact_sheet(films: Sequence[Film], classes: Sequence[str], half_extent: float) -> Figure:
    """Four frames of each demonstration, from first to last, with their tracked boxes.

    Boxes have their class's colour and number, which the legend explains. Objects that have
    moved have a thick box and a filled label. The videos are at least 1, of any sizes.
    """
    cell = HALF / _COLUMNS
    shown = _classes_shown(films)
    rows = -(-len(shown) // _LEGEND)
    height = len(films) * (cell + _ROW) + 0.3 + 0.24 * rows
    figure = Figure(figsize=(HALF, height))
    for row, film in enumerate(films):
        picks = np.linspace(0, len(film.frames) - 1, _COLUMNS).round().astype(int).tolist()
        bottom = height - (row + 1) * (cell + _ROW)
        top = 1 - (row * (cell + _ROW) + 0.16) / height
        figure.text(0.004, top, shortened(film.name), va="top", weight="bold")
        for column, t in enumerate(picks):
            place = (column / _COLUMNS + 0.004, bottom / height, 0.242, 0.968 * cell / height)
            axes = figure.add_axes(place)
            axes.imshow(_boxed(film, t, classes, half_extent, shown), aspect="equal")
            axes.set_axis_off()
            axes.set_title(f"frame {t}", fontsize=9, pad=3)
    patches = [Patch(color=_colour(i, classes, shown)) for i in shown]
    labels = [f"{n}  {shortened(classes[i], 28)}" for n, i in enumerate(shown)]
    figure.legend(patches, labels, loc="lower center", ncols=min(_LEGEND, len(shown)))
    return figure


def _classes_shown(films: Sequence[Film]) -> list[int]:
    """Labels that occur; their index in this list is the number on their boxes."""
    return np.unique([label for film in films for label in film.tracks.label]).tolist()


def _colour(label: int, classes: Sequence[str], shown: list[int]) -> str:
    plain = [i for i in shown if classes[i] not in _CLASS_COLOURS]
    if label not in plain:
        return _CLASS_COLOURS[classes[label]]
    return COLOURS[plain.index(label) % len(COLOURS)]


def _boxed(
    film: Film, t: int, classes: Sequence[str], half_extent: float, shown: list[int]
) -> UInt8[np.ndarray, "H W 3"]:
    """One frame with its boxes and their numbers."""
    image = film.frames[t].copy()
    height, width = image.shape[:2]
    scale = width / (2 * half_extent)
    tracks, middle = film.tracks, np.array([(width - 1) / 2, (height - 1) / 2])
    for i, label in enumerate(tracks.label):
        moved = film.active is not None and bool(film.active[t, i])
        rgb = _rgb(_colour(int(label), classes, shown))
        at = middle + tracks.center[t, i] * scale * [1, -1]
        half = tracks.size[t, i] * scale / 2
        corners = np.round(np.array([at - half, at + half]) * 2**_SHIFT).astype(int).tolist()
        cv2.rectangle(image, *corners, rgb, 3 if moved else 1, cv2.LINE_AA, _SHIFT)
        _tag(image, str(shown.index(label)), at - half, rgb, moved)
    return image


def _tag(image: np.ndarray, text: str, corner: np.ndarray, rgb: list[int], filled: bool) -> None:
    """A label above a box's upper left corner, or inside it at the picture's upper edge."""
    zoom = image.shape[0] / 384
    width, height = round((8 + 10 * len(text)) * zoom), round(19 * zoom)
    left = int(np.clip(corner[0], 0, image.shape[1] - width))
    top = int(np.clip(corner[1] - height, 0, image.shape[0] - height))
    box = (left, top), (left + width - 1, top + height - 1)
    cv2.rectangle(image, *box, rgb if filled else (255,) * 3, -1)
    cv2.rectangle(image, *box, rgb, 1)
    ink = (255,) * 3 if filled else rgb
    place = (left + round(4 * zoom), top + height - round(4 * zoom))
    thick = max(1, round(1.6 * zoom))
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.52 * zoom, ink, thick, cv2.LINE_AA)


def _rgb(colour: str) -> list[int]:
    return [round(255 * part) for part in to_rgb(colour)]
