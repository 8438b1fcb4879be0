"""Videos of a kitchen table: a hand brings a cup to a coaster, then a spoon into the cup.

`story` plays one video out as true boxes, `painted` draws it (textured ground, changing light,
camera noise), and `tracked` makes of the true boxes what a tracker would report.

    python tests/support/kitchen_films.py videos     # twelve videos with boxes, in a new folder
"""

import csv
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from gril_jax.demos.vision.video import write_video

CLASSES = ("cup", "coaster", "spoon", "hand")
COLUMNS = "frame,class,x_min,y_min,x_max,y_max,confidence,track"
_SIZES = {"cup": (62, 70), "coaster": (104, 92), "spoon": (30, 84), "hand": (96, 112)}
_COLOURS = {"cup": (70, 90, 190), "coaster": (60, 120, 70), "spoon": (205, 205, 215),
            "hand": (214, 170, 140)}  # fmt: skip
_LIFT = 4  # pixels between a hand's centre and what it holds


class Story(NamedTuple):
    """One video as it really was."""

    boxes: np.ndarray  # (T, 4 objects, x_min y_min x_max y_max), pixels, in the order of CLASSES
    ends: tuple[int, int]  # frames at which cup and spoon have come to rest
    fps: float
    width: int
    height: int


@dataclass(frozen=True)
class Tracker:
    """Faults of a tracker; a clean one has none."""

    jitter: float = 0.0  # standard deviation of an edge's error, pixels
    dropped: float = 0.0  # share of the boxes that are missing
    switched: float = 0.0  # share of the frames in which two near objects exchange their boxes
    late: float = 0.0  # seconds, at most, until an object is first found
    squeezed: float = 0.0  # share by which the hand's shade shrinks a box, at most


ROUGH = Tracker(jitter=3.0, dropped=0.1, switched=0.01, late=0.5, squeezed=0.15)


def story(seed, *, fps=30.0, width=640, height=480, tempo=1.0):
    """A video of about ten seconds at a tempo of 1; places and ways are those of the seed."""
    rng = np.random.default_rng(seed)
    low, high = np.array([0.16, 0.2]), np.array([0.84, 0.8])
    while True:
        cup, coaster, spoon = rng.uniform(low, high, (3, 2)) * [640, 480]
        pairs = ((cup, coaster), (cup, spoon), (spoon, coaster))
        if min(np.linalg.norm(a - b) for a, b in pairs) > 150:
            break
    aside = np.array([rng.choice([-70, 710]), rng.uniform(120, 400)])
    rest = (coaster + spoon) / 2 + rng.uniform(-60, 60, 2)
    inside = coaster + [0, -26]
    legs = [  # to where, in seconds, and what comes along
        (aside, 0.5, None), (cup, 1.2, None), (cup, 0.3, None), (coaster, 1.5, 0),
        (coaster, 0.3, None), (rest, 0.9, None), (spoon, 0.9, None), (spoon, 0.3, None),
        (inside, 1.4, 2), (inside, 0.3, None), (aside, 1.1, None), (aside, 0.6, None),
    ]  # fmt: skip
    places, hand, ends, held = {0: cup, 1: coaster, 2: spoon}, aside, [], []
    frames = []
    for to, seconds, carries in legs:
        count = max(2, round(seconds * fps * rng.uniform(0.8, 1.25) / tempo))
        begin = hand
        for step in range(1, count + 1):
            share = 0.5 - 0.5 * np.cos(np.pi * step / count)  # slow, fast, slow
            hand = begin + share * (to - begin)
            if carries is not None:
                places = places | {carries: hand}
            frames.append([places[0], places[1], places[2], hand + [0, _LIFT]])
        if carries is not None:
            ends.append(len(frames) - 1)
            held.append(carries)
    assert held == [0, 2]
    scale = np.array([width / 640, height / 480])
    half = np.array([_SIZES[name] for name in CLASSES]) * scale / 2
    center = np.array(frames) * scale
    return Story(np.concatenate([center - half, center + half], axis=2), (*ends,), fps, width,
                 height)  # fmt: skip


def painted(told, seed=0):
    """The frames of a story, one at a time, RGB."""
    rng = np.random.default_rng(seed)
    height, width = told.height, told.width
    coarse = rng.normal(0, 1, (height // 16, width // 16, 3))
    ground = 132 + 12 * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    ground += 7 * np.sin(np.arange(width) / 9)[None, :, None]
    noise = rng.normal(0, 5, (8, height, width, 1)).astype(np.float32)
    for number, boxes in enumerate(told.boxes):
        picture = ground.astype(np.float32).copy()
        for which in (1, 0, 2, 3):  # from below to above
            _draw(picture, CLASSES[which], boxes[which])
        light = 1 + 0.12 * np.sin(2 * np.pi * number / told.fps / 4 + seed)
        yield np.clip(picture * light + noise[number % 8], 0, 255).astype(np.uint8)


def _draw(picture, name, box):
    low, high = np.round(box[:2]).astype(int), np.round(box[2:]).astype(int)
    middle, half = (low + high) // 2, np.maximum((high - low) // 2, 1)
    colour = _COLOURS[name]
    dark = tuple(0.6 * part for part in colour)
    if name == "coaster":
        cv2.rectangle(picture, low.tolist(), high.tolist(), colour, -1)
        cv2.rectangle(picture, low.tolist(), high.tolist(), dark, 3)
        return
    if name == "spoon":
        head = (middle - [0, half[1] // 2]).tolist()
        cv2.ellipse(picture, head, (half // [1, 2]).tolist(), 0, 0, 360, colour, -1)
        cv2.line(picture, middle.tolist(), [int(middle[0]), int(high[1])], dark, 5)
        return
    cv2.ellipse(picture, middle.tolist(), half.tolist(), 0, 0, 360, colour, -1)
    cv2.ellipse(picture, middle.tolist(), (half * 2 // 3).tolist(), 0, 0, 360, dark, 3)


def tracked(told, tracker=Tracker(), seed=0):
    """Rows of `COLUMNS` as a tracker reports them."""
    rng = np.random.default_rng(seed)
    boxes = told.boxes.copy()
    hand = boxes[:, 3]
    middle = (hand[:, :2] + hand[:, 2:]) / 2
    for which in range(3):
        center, size = (
            (boxes[:, which, :2] + boxes[:, which, 2:]) / 2,
            np.diff(boxes[:, which].reshape(-1, 2, 2), axis=1)[:, 0],
        )
        near = np.linalg.norm(center - middle, axis=1) < 90
        shrunk = size * (1 - tracker.squeezed * near[:, None] * rng.uniform(0, 1, (len(near), 1)))
        boxes[:, which] = np.concatenate([center - shrunk / 2, center + shrunk / 2], axis=1)
    boxes += rng.normal(0, 1, boxes.shape) * tracker.jitter
    boxes[..., 2:] = np.maximum(boxes[..., 2:], boxes[..., :2] + 4)
    seen = rng.uniform(size=boxes.shape[:2]) >= tracker.dropped
    for which in range(4):
        seen[: int(rng.uniform(0, tracker.late) * told.fps), which] = False
    track = np.tile(np.arange(4), (len(boxes), 1))
    for number in np.flatnonzero(rng.uniform(size=len(boxes)) < tracker.switched):
        center = told.boxes[number].reshape(4, 2, 2).mean(axis=1)
        apart = np.linalg.norm(center[:, None] - center, axis=-1) + 1e9 * np.eye(4)
        one, other = np.unravel_index(np.argmin(apart), apart.shape)
        boxes[number, [one, other]] = boxes[number, [other, one]]
        track[number:, one] += 10  # and a tracker begins a new identity
    outside = (boxes[..., 2:] <= 0).any(-1) | (boxes[..., :2] >= [told.width, told.height]).any(-1)
    for number, which in np.argwhere(seen & ~outside):
        edges = np.round(boxes[number, which], 2).tolist()
        sure = round(float(rng.uniform(0.6, 1)), 2)
        yield int(number), CLASSES[which], *edges, sure, int(track[number, which])


def write_csv(path, rows):
    """Writes rows of `tracked` as our CSV, with two further columns."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS.split(","))
        writer.writerows(rows)


def write_films(folder, count=12, *, tracker=Tracker(), seed=0, films=True, **look):
    """Videos and boxes in a new folder; returns the stories by their names."""
    folder.mkdir(parents=True, exist_ok=True)
    stories = {}
    for number in range(count):
        told = story(1000 * seed + number, **look)
        name = f"kitchen_{number:02d}"
        if films:
            write_video(folder / f"{name}.mp4", painted(told, number), told.fps)
        write_csv(folder / f"{name}.csv", tracked(told, tracker, 1000 * seed + number))
        stories[name] = told
    return stories


if __name__ == "__main__":
    write_films(Path(sys.argv[1]))
