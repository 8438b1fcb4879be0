"""Films of a demonstration set with the boxes that a rough tracker would find in them.

What is known of such a set is made worse: jitter of 3 pixels at each edge of a picture of 640, a
tenth of the boxes missing, and in 1 % of the frames the two nearest things exchange their boxes,
after which the tracker gives one of them another identity. Pictures are grey.
"""

import csv

import numpy as np

from gril_jax.demos.demo_set import load_demo_set
from gril_jax.demos.vision.video import write_video
from support.kitchen_films import COLUMNS

WIDTH = 640


def write_films(source, folder, *, rough=True, seed=0):
    """Films and our CSV beside them, of the frames and at the rate of a set; the set."""
    folder.mkdir(parents=True)
    made = load_demo_set(source)
    for number, entry in enumerate(made):
        tracks = entry.tracks
        rows = _rows(tracks, made.half_extent, np.random.default_rng([seed, number]), rough)
        with open(folder / f"{entry.name}.csv", "w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(COLUMNS.split(","))
            for frame, which, *rest in rows:
                table.writerow([frame, made.classes[tracks.label[which]], *rest])
        picture = np.full((WIDTH, WIDTH, 3), 120, np.uint8)
        write_video(folder / f"{entry.name}.mp4", [picture] * len(tracks.center), made.fps)
    return made


def _rows(tracks, half_extent, rng, rough):
    """(frame, object, x_min, y_min, x_max, y_max, confidence, identity) of what is seen."""
    scale = WIDTH / (2 * half_extent)
    center = (tracks.center * [1, -1] + half_extent) * scale
    (length, number), half = (
        center.shape[:2],
        np.broadcast_to(tracks.size, center.shape) * scale / 2,
    )
    boxes = np.concatenate([center - half, center + half], axis=-1)
    seen = np.broadcast_to(tracks.seen, (length, number)).copy()
    identity = np.tile(np.arange(number), (length, 1))
    if rough:
        boxes += rng.normal(0, 3, boxes.shape)
        boxes[..., 2:] = np.maximum(boxes[..., 2:], boxes[..., :2] + 4)
        seen &= rng.uniform(size=seen.shape) >= 0.1
        for t in np.flatnonzero(rng.uniform(size=length) < 0.01):
            apart = np.linalg.norm(center[t, :, None] - center[t], axis=-1) + 1e9 * np.eye(number)
            one, other = np.unravel_index(np.argmin(apart), apart.shape)
            boxes[t, [one, other]] = boxes[t, [other, one]]
            identity[t:, one] += number
    within = (boxes[..., 2:] > 0).all(-1) & (boxes[..., :2] < WIDTH).all(-1)
    for t, which in np.argwhere(seen & within).tolist():
        yield t, which, *np.round(boxes[t, which], 2).tolist(), 0.9, int(identity[t, which])


def true_ends(made, place):
    """Seconds at which what is brought into an object is there for good, in order, by film; those
    that the set knows where it does."""
    found = {}
    for entry in made:
        tracks = entry.tracks
        if entry.stages:
            found[entry.name] = sorted(t / made.fps for t in entry.stages.values() if t >= 0)
            continue
        names = [made.classes[label] for label in tracks.label]
        goal, acts = names.index(place), np.isin(names, [*made.robots])
        half = np.broadcast_to(tracks.size, tracks.center.shape)[:, goal, None] / 2
        off = np.abs(tracks.center - tracks.center[:, goal, None])
        outside = (off > half).any(axis=-1)
        brought = np.flatnonzero(outside[0] & ~outside[-1] & ~acts)
        found[entry.name] = sorted(
            (np.flatnonzero(outside[:, which])[-1] + 1) / made.fps for which in brought
        )
    return found
