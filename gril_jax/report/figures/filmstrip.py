"""Pictures made of frames: demonstrations with their boxes, a rollout beside its reward.

T is frames, N objects. Positions and sizes are in world units, with the origin in the middle of
a frame and y up; half_extent is half the width of the world that a frame shows.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gril_jax.demos.demo import Tracks
from gril_jax.errors import ShapeError

from .style import COLOURS, GREY, HALF, pixels, shortened, styled

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
    moved have a thick box and a filled label. The films are at least 1, of any sizes.
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


def with_boxes(film: Film, classes: Sequence[str], half_extent: float) -> Iterator[np.ndarray]:
    """The frames of a demonstration with their boxes, and a legend of the objects beside them.

    Names turn bold once their object has moved. All pictures are of one size with even sides.
    """
    shown = _classes_shown([film])
    side = _even(film.frames.shape[1])
    names = [f"{n}  {classes[i]}" for n, i in enumerate(shown)]
    colours = [_colour(i, classes, shown) for i in shown]
    idle, bold = (_legend(names, colours, side, moved) for moved in (False, True))
    band = side // (len(names) + 1)
    for t in range(len(film.frames)):
        panel = idle.copy()
        for n, label in enumerate(shown):
            if film.active is not None and film.active[t, film.tracks.label == label].any():
                panel[n * band : (n + 1) * band] = bold[n * band : (n + 1) * band]
        done = 8 + round((panel.shape[1] - 16) * t / max(1, len(film.frames) - 1))
        cv2.line(panel, (8, side - 10), (panel.shape[1] - 8, side - 10), (225,) * 3, 4)
        cv2.line(panel, (8, side - 10), (done, side - 10), (110,) * 3, 4)
        picture = _boxed(film, t, classes, half_extent, shown)
        yield np.hstack([_padded(picture, side), panel])


@styled
def _legend(names, colours, height: int, moved: bool) -> UInt8[np.ndarray, "H W 3"]:
    figure = _figure(200, height)
    band = (height // (len(names) + 1)) / height
    for n, (name, colour) in enumerate(zip(names, colours, strict=True)):
        y = 1 - (n + 0.5) * band
        style = {"weight": "bold"} if moved else {"color": GREY}
        figure.text(0.05, y, "■", color=colour, va="center", fontsize=13)
        figure.text(0.15, y, shortened(name, 20), va="center", fontsize=11, **style)
    return pixels(figure)


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


def beside_reward(
    frames: UInt8[np.ndarray, "T H W 3"],
    reward: Float[np.ndarray, "R"],
    *,
    title: str = "Learned reward",
) -> Iterator[np.ndarray]:
    """Frames beside the curve of their reward, which grows along with them.

    The frames are of a demonstration, or of a rollout with its reset as frame 0, and the rewards
    one a frame, or one a step: R is T or T - 1, or it is a ShapeError. Where a reward is not finite
    the curve has a gap. Yields RGB frames, all of one size with even sides.
    """
    first = len(frames) - len(reward)  # the frame that reward[0] belongs to
    if first not in (0, 1):
        raise ShapeError(
            f"reward: there are {len(reward)} values for {len(frames)} frames, but there must "
            "be one a frame, or one a frame after the first."
        )
    return _beside(frames, reward, first, title)


def _beside(frames: np.ndarray, reward: np.ndarray, first: int, title: str) -> Iterator[np.ndarray]:
    height, width = (_even(length) for length in frames.shape[1:3])
    panel, points = _empty_axes(reward, first, height, title)
    blue, red = map(_rgb, COLOURS[:2])
    fixed = np.round(np.nan_to_num(points) * 2**_SHIFT).astype(np.int32)
    known = np.isfinite(points).all(axis=1)
    for t, frame in enumerate(frames):
        now = t - first
        # The curve stays on the panel; only its newest piece is drawn. The dot is not kept.
        if now > 0 and known[now - 1] and known[now]:
            piece = [fixed[now - 1 : now + 1]]
            cv2.polylines(panel, piece, False, blue, 2, cv2.LINE_AA, _SHIFT)
        shown = panel.copy()
        if now >= 0 and known[now]:
            cv2.circle(shown, fixed[now].tolist(), 5 << _SHIFT, red, -1, cv2.LINE_AA, _SHIFT)
        yield np.hstack([_padded(frame, height, width), shown])


@styled
def _empty_axes(
    reward: np.ndarray, first: int, height: int, title: str
) -> tuple[UInt8[np.ndarray, "H W 3"], Float[np.ndarray, "R 2"]]:
    """A panel with axes that fit the whole curve, and the curve's points in its pixels."""
    finite = reward[np.isfinite(reward)]
    low, high = (finite.min(), finite.max()) if len(finite) else (-1.0, 0.0)
    room = 0.08 * (high - low) or 0.1
    steps = np.arange(len(reward)) + first
    figure = _figure(_even(5 * height // 4), height)
    axes = figure.add_axes((0.16, 0.14, 0.8, 0.76))
    axes.set(title=title, xlabel="frame")
    axes.set(xlim=(0, max(1, steps[-1]) * 1.02), ylim=(low - room, high + room))
    panel = pixels(figure)
    points = axes.transData.transform(np.stack([steps, reward], axis=1).astype(float))
    return panel, np.stack([points[:, 0], panel.shape[0] - points[:, 1]], axis=1) - 0.5


def _figure(width: int, height: int) -> Figure:
    """A figure of this size in pixels; the half prevents rounding in inches from losing one."""
    return Figure(figsize=((width + 0.5) / 100, (height + 0.5) / 100), dpi=100)


def _rgb(colour: str) -> list[int]:
    return [round(255 * part) for part in to_rgb(colour)]


def _even(length: int) -> int:
    """The length rounded up to even: video codecs halve the resolution of colours."""
    return 2 * -(-length // 2)


def _padded(frame: np.ndarray, height: int, width: int | None = None) -> np.ndarray:
    below, right = height - frame.shape[0], (width or _even(frame.shape[1])) - frame.shape[1]
    return np.pad(frame, ((0, below), (0, right), (0, 0)), mode="edge")
