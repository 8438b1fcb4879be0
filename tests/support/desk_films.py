"""Films of a desk from above, boxes of what can be seen: a detector's, not those of whole things.

Where a hand lies upon a thing its box ends, and where nothing is left to see there is none; boxes
end at the picture's edge. Hands and things have another size in each film, the hand may hang on an
arm that reaches into the picture; things grow as they are lifted, and the hand stops for a moment
on its way or before it goes.
"""

from dataclasses import dataclass

import numpy as np

from gril_jax.demos.vision.video import write_video
from support.kitchen_films import Story

RECIPES = {  # what the hand carries to where, in order
    "mug": (("mug", "saucer"), ("sugar", "mug")),
    "desk": (("stapler", "drawer"), ("pen", "cup")),
    "fruit": (("apple", "basket"), ("banana", "basket")),
    "shelf": (("book", "shelf"), ("lamp", "table mat")),
}
_SIZES = {
    "mug": (54, 58), "saucer": (96, 80), "sugar": (26, 26), "stapler": (70, 30),
    "drawer": (150, 110), "pen": (60, 12), "cup": (48, 60), "apple": (44, 44), "banana": (80, 40),
    "basket": (140, 120), "book": (70, 96), "shelf": (200, 110), "lamp": (60, 60),
    "table mat": (130, 90), "clock": (50, 50),
}  # fmt: skip
W, H, FPS = 640, 480, 30.0


@dataclass(frozen=True)
class Faults:
    """Those of a detector and a tracker."""

    jitter: float = 2.0  # pixels, of an edge
    dropped: float = 0.05  # share of boxes
    switched: float = 0.005  # share of frames at which two near things exchange their boxes
    lasting: int = 5  # frames that such an exchange may last
    late: float = 0.5  # seconds
    parts: bool = True  # boxes of what is to be seen; else those three quarters covered are lost


ROUGH = Faults(jitter=3.0, dropped=0.1, switched=0.01, parts=False)


def names_of(recipe):
    """The classes of a recipe, in the order of the objects."""
    words = dict.fromkeys(word for move in RECIPES[recipe] for word in reversed(move))
    return (*words, "clock", "hand")


def story(seed, recipe="mug", *, arm=False):
    """A film, played out."""
    rng = np.random.default_rng([seed, 123])
    names = names_of(recipe)
    scale = rng.uniform(0.8, 1.25)
    size = np.array([_SIZES[name] for name in names[:-1]], float) * scale
    reach = rng.uniform(90, 150, 2) * scale
    place = _laid_out(rng, size)
    low = np.array([rng.uniform(50, W - 50), H + 110.0])
    side = np.array([rng.choice([-100.0, W + 100.0]), rng.uniform(50, H - 50)])
    aside = low if arm or rng.uniform() < 0.5 else side
    hand, held_by, ends, frames, sizes = aside, {}, [], [], []
    lifted = np.ones(len(size))

    def wait(least, most):
        for _ in range(max(1, round(rng.uniform(least, most) * FPS))):
            frames.append(np.concatenate([place, hand[None]]))
            sizes.append(np.concatenate([size * lifted[:, None], reach[None]]))

    def go(to, seconds, carried=None):
        nonlocal hand, place
        count, begin, lead = max(3, round(seconds * FPS)), hand, place.copy()
        pause = round(rng.uniform(0.3, 0.6) * count) if rng.uniform() < 0.3 else 0
        bow, pace = rng.normal(0, 25, 2), rng.integers(3)
        for step in range(1, count + 1):
            share = step / count
            share = (share, share**3 * (10 + share * (6 * share - 15)),
                     0.5 - 0.5 * np.cos(np.pi * share))[pace]  # fmt: skip
            hand = begin + share * (to - begin) + np.sin(np.pi * share) * bow
            for one in () if carried is None else (carried, *held_by.get(carried, ())):
                place[one] = lead[one] + hand - begin
                lifted[one] = 1 + 0.18 * np.sin(np.pi * share)
            wait(0, 0)
            if step == pause:
                wait(0.3, 0.9)

    wait(0.1, 2.0)
    for thing, target in RECIPES[recipe]:
        one, at = names.index(thing), names.index(target)
        grip = rng.uniform(-0.25, 0.25, 2) * size[one] + [0, rng.uniform(0, 30)]
        go(place[one] + grip, rng.uniform(0.5, 1.6))
        wait(0.1, 0.6)
        inside = place[at] + rng.uniform(-0.2, 0.2, 2) * size[at]
        go(inside + grip, rng.uniform(0.7, 2.2), one)
        lifted[:] = 1
        ends.append(len(frames) - 1)
        held_by.setdefault(at, []).append(one)
        wait(0.1, 0.8)
        if rng.uniform() < 0.6:
            go(hand + rng.uniform(-180, 180, 2), rng.uniform(0.4, 1.2))
            wait(0, 0.8)
    go(aside, rng.uniform(0.6, 1.3))
    wait(0.2, 1.5)
    center, half = np.array(frames), np.array(sizes) / 2
    boxes = np.concatenate([center - half, center + half], axis=2)
    if arm:
        boxes[:, -1, 3] = np.maximum(boxes[:, -1, 3], H + 5)
    return Story(boxes, (*ends,), FPS, W, H)


def _laid_out(rng, size):
    """Centres of things that lie in the picture and do not touch."""
    while True:
        place = rng.uniform(size / 2 + 10, np.array([W, H]) - size / 2 - 10)
        apart = np.abs(place[:, None] - place) - (size[:, None] + size) / 2
        if (apart.max(axis=-1) + 1e9 * np.eye(len(size)) > 8).all():
            return place


def tracked(told, faults=Faults(), seed=0):
    """Rows of MOTChallenge, classes numbered from 1."""
    rng = np.random.default_rng([seed, 77])
    boxes, (length, number) = told.boxes.copy(), told.boxes.shape[:2]
    seen = rng.uniform(size=(length, number)) >= faults.dropped
    for which in range(number - 1):
        if faults.parts:
            boxes[:, which] = _seen_part(told.boxes[:, which], told.boxes[:, -1])
        else:
            seen[:, which] &= _covered(told.boxes[:, which], told.boxes[:, -1]) < 0.75
    seen &= (boxes[..., 2:] - boxes[..., :2]).min(axis=-1) > 4 * faults.parts
    boxes += rng.normal(0, faults.jitter, boxes.shape)
    for which in range(number):
        seen[: int(rng.uniform(0, faults.late) * FPS), which] = False
    track = np.tile(np.arange(1, number + 1), (length, 1))
    for t in np.flatnonzero(rng.uniform(size=length) < faults.switched):
        center = told.boxes[t].reshape(number, 2, 2).mean(axis=1)
        apart = np.linalg.norm(center[:, None] - center, axis=-1) + 1e9 * np.eye(number)
        one, other = np.unravel_index(np.argmin(apart), apart.shape)
        while_ = slice(t, t + int(rng.integers(1, faults.lasting + 1)))
        boxes[while_, [one, other]] = boxes[while_, [other, one]]
        track[t:, one] += number
    boxes = np.clip(boxes, 0, [W, H, W, H]).round(1)
    for t, which in np.argwhere(seen & ((boxes[..., 2:] - boxes[..., :2]).min(axis=-1) > 4)):
        (left, top), (right, low) = boxes[t, which].reshape(2, 2)
        rows = f"{left:.1f},{top:.1f},{right - left:.1f},{low - top:.1f}"
        yield f"{t + 1},{track[t, which]},{rows},{rng.uniform(0.4, 1):.2f},{which + 1},1"


def _seen_part(boxes, hand):
    """Boxes without the side that lies under the hand, where it covers a whole side."""
    seen = boxes.copy()
    for axis, across in ((0, 1), (1, 0)):
        over = (hand[:, across] <= boxes[:, across]) & (hand[:, across + 2] >= boxes[:, across + 2])
        low, high = boxes[:, axis], boxes[:, axis + 2]
        first, last = over & (hand[:, axis] <= low), over & (hand[:, axis + 2] >= high)
        seen[first, axis] = np.clip(hand[:, axis + 2], low, high)[first]
        seen[last & ~first, axis + 2] = np.clip(hand[:, axis], low, high)[last & ~first]
    return seen


def _covered(boxes, hand):
    """The share of a box that is under the hand's."""
    common = np.minimum(boxes[:, 2:], hand[:, 2:]) - np.maximum(boxes[:, :2], hand[:, :2])
    return np.prod(np.maximum(common, 0), axis=1) / np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)


def write_films(folder, count=12, *, recipe="mug", arm=False, faults=Faults(), seed=0):
    """Boxes, names and black films in a new folder; the stories by their names."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "names.txt").write_text("\n".join(names_of(recipe)) + "\n")
    stories = {}
    for number in range(count):
        told, name = story(100 * seed + number, recipe, arm=arm), f"desk_{number:02d}"
        write_video(folder / f"{name}.mp4", np.zeros((len(told.boxes), H, W, 3), np.uint8), FPS)
        rows = tracked(told, faults, 100 * seed + number)
        (folder / f"{name}.txt").write_text("\n".join(rows) + "\n")
        stories[name] = told
    return stories
