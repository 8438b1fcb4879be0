"""Follows boxes that a person drew on the first frame of each film, by what it looks like.

    {"kitchen_00": [{"class": "cup", "box": [317, 295, 371, 349]}, ...], ...}

A box is x_min, y_min, x_max, y_max in pixels; `"frame": 20` says that it is drawn on that frame, as
for a hand that comes later. Each later frame is searched for what was in the box on it, by
normalised cross-correlation: light may change, and nothing drifts. What turns, comes much nearer to
the camera, or fills little of its box is lost, and so is what a hand hides until it is seen again;
there it has no box. Of OpenCV's own trackers its headless builds still have MIL alone without
weights: it was 28 pixels off for what lay still under a passing hand.
"""

from pathlib import Path

import cv2
import numpy as np

from gril_jax.demos.formats.json_text import field, load
from gril_jax.demos.formats.record import Box, Film, box, checked, whole
from gril_jax.demos.vision.timed import frames_of
from gril_jax.errors import DemoError

_WIDEST = 640  # pixels of the pictures that are searched
_ALIKE = 0.5  # correlation from which it is the object
_SURER = 0.2  # more of it once an object has been lost for a second and may be anywhere
_REACH, _WIDER = (
    0.5,
    0.25,
)  # diagonals that are searched around it, and more a frame once it is lost


def follower(file: Path):
    """(film) -> boxes in all its frames, from those that the file has of its first one."""
    drawn = load(file)
    if not isinstance(drawn, dict):
        raise DemoError(f"{file}: must have the boxes of each film by its name.")

    def follow(film: Film) -> list[Box]:
        where = f"{file}, film {film.path.stem!r}"
        rows = field(drawn, film.path.stem, list, str(file))
        given = []
        for n, one in enumerate(rows):
            at = f"{where}, box {n}"
            edges = field(one, "box", list, at)
            if len(edges) != 4:
                raise DemoError(f"{at}: box must be x_min, y_min, x_max and y_max.")
            frame = whole(one.get("frame", 0), "frame", at, least=0)
            given.append(box(film, frame, field(one, "class", str, at), edges, at, track=n))
            low_x, low_y, high_x, high_y = given[-1].edges
            if low_x < 0 or low_y < 0 or high_x > film.width or high_y > film.height:
                raise DemoError(
                    f"{at}: the box must lie within the picture, which is {film.width} x "
                    f"{film.height} pixels."
                )
        if not given:
            raise DemoError(f"{where}: no box is drawn on its first frame.")
        return checked(_followed(film, given), file, film)

    return follow


def _followed(film: Film, given: list[Box]) -> list[Box]:
    """The boxes of all frames in which their objects are found."""
    found, patches = [*given], {}
    place = np.array([one.edges for one in given])
    missed = np.zeros(len(given))
    for number, picture in enumerate(frames_of(film, _WIDEST)):
        scale = film.width / picture.shape[1]
        for which, patch in patches.items():
            diagonal = np.linalg.norm(patch.shape[:2])
            reach = diagonal * (_REACH + _WIDER * missed[which])
            around = place[which] / scale + reach * np.array([-1, -1, 1, 1])
            corner, score = _search(picture, patch, around)
            if score < _ALIKE + _SURER * min(missed[which] / film.fps, 1.0):
                missed[which] += 1
                continue
            size = given[which].edges
            low = corner * scale
            place[which] = [*low, low[0] + size[2] - size[0], low[1] + size[3] - size[1]]
            missed[which] = 0
            edges = tuple(place[which].tolist())
            found.append(given[which]._replace(frame=number, edges=edges, confidence=score))
        for which, one in enumerate(given):
            if one.frame == number:
                patches[which] = _cut(picture, np.array(one.edges) / scale)[0]
    return found


def _search(picture: np.ndarray, patch: np.ndarray, around: np.ndarray) -> tuple[np.ndarray, float]:
    """The upper left corner at which a patch is found best near a place, and how well: 1 is
    equal."""
    window, corner = _cut(picture, around)
    if window.shape[0] < patch.shape[0] or window.shape[1] < patch.shape[1]:
        return corner, -1.0
    likeness = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
    _, score, _, (x, y) = cv2.minMaxLoc(likeness)
    part = [_between(likeness[y], x), _between(likeness[:, x], y)]
    return corner + [x, y] + part, float(score)


def _cut(picture: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part of a picture within edges, at least 4 pixels wide, and its upper left corner."""
    height, width = picture.shape[:2]
    low = np.clip(np.round(edges[:2]).astype(int), 0, [width - 4, height - 4])
    high = np.clip(np.round(edges[2:]).astype(int), low + 4, [width, height])
    return picture[low[1] : high[1], low[0] : high[0]], low


def _between(line: np.ndarray, at: int) -> float:
    """Pixels from a maximum to the top of the parabola through it and its neighbours."""
    if not 0 < at < len(line) - 1:
        return 0.0
    before, here, after = (float(value) for value in line[at - 1 : at + 2])
    bend = before - 2 * here + after
    return float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0
