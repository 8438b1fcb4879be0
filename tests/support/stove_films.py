"""Films of a stove from above: a hand sets a pot on the hob, then the lid on the pot.

Another kitchen than that of `kitchen_films`: tiles, a lamp that is dimmed, curved ways of the hand,
pauses, an onion that only lies there, and a tracker whose errors last for some frames. It writes
MOTChallenge text with a names file, or the boxes of each first frame for `--track`.
"""

import json
from dataclasses import dataclass

import cv2
import numpy as np

from gril_jax.demos.vision.video import write_video
from support.kitchen_films import Story

RECIPES = {  # what the hand carries to where, in order
    "lid on pot": (("pot", "hob"), ("lid", "pot")),
    "bread and jar": (("bread", "plate"), ("jar", "tray")),
    "three": (("bowl", "mat"), ("egg", "bowl"), ("whisk", "bowl")),
}
_SIZES = {
    "hob": (130, 130), "pot": (96, 84), "lid": (80, 72), "hand": (120, 100), "onion": (40, 38),
    "bread": (84, 50), "plate": (110, 104), "jar": (44, 66), "tray": (150, 90), "bowl": (90, 80),
    "mat": (120, 110), "egg": (32, 36), "whisk": (34, 90),
}  # fmt: skip
_MARGIN = 0.14  # of the picture, in which nothing is put


@dataclass(frozen=True)
class Faults:
    """Those of a tracker; without arguments the boxes are true."""

    jitter: float = 0.0  # pixels, of an edge
    lasting: float = 0.0  # correlation of an error from one frame to the next
    dropped: float = 0.0  # share of boxes
    burst: float = 1.0  # frames that boxes are missing for at once, on average
    switched: float = 0.0  # share of frames at which two near objects exchange their boxes
    late: float = 0.0  # seconds
    spurious: float = 0.0  # boxes a frame of what is not there
    hidden: float = 0.0  # share of a box that must lie under the hand for it to be lost


TRACKER = Faults(jitter=2.0, lasting=0.5, dropped=0.07, burst=3.0, switched=0.005, late=0.4,
                 spurious=0.01, hidden=0.9)  # fmt: skip


def names_of(recipe="lid on pot"):
    """The classes of a recipe, in the order of the objects."""
    words = dict.fromkeys(word for move in RECIPES[recipe] for word in reversed(move))
    return (*words, "onion", "hand")


def story(seed, recipe="lid on pot", *, fps=30.0, width=640, height=480, tempo=1.0):
    """A film of about ten seconds, played out; everything lies elsewhere by the seed."""
    rng = np.random.default_rng([seed, 7])
    names = names_of(recipe)
    size = np.array([_SIZES[name] for name in names], float)
    place = _laid_out(rng, size[:-1])
    aside = np.array([rng.uniform(60, 580), rng.choice([-90.0, 570.0])])
    hand, held_by, ends, frames = aside, {}, [], []

    def go(to, seconds, carried=None):
        nonlocal hand, place
        count = max(2, round(seconds * rng.uniform(0.75, 1.35) * fps / tempo))
        begin, lead = hand, place.copy()
        bow = rng.normal(0, 0.12) * np.array([[0, 1], [-1, 0]]) @ (to - begin)
        for step in range(1, count + 1):
            share = step / count
            share = share * share * (3 - 2 * share)
            hand = begin + share * (to - begin) + 4 * share * (1 - share) * bow
            if carried is not None:
                for one in (carried, *held_by.get(carried, ())):
                    place[one] = lead[one] + hand - begin
            frames.append(np.concatenate([place, hand[None]]))

    go(aside, rng.uniform(0.2, 0.8))
    for thing, target in RECIPES[recipe]:
        one, at = names.index(thing), names.index(target)
        grip = rng.uniform(-6, 6, 2)
        go(place[one] + grip, 1.1)
        go(hand, 0.3)
        go(place[at] + grip + rng.normal(0, 4, 2), 1.4, one)
        ends.append(len(frames) - 1)
        held_by.setdefault(at, []).append(one)
        go(hand, 0.25)
        go(place[at] + rng.uniform(-150, 150, 2), 0.8)
    go(aside, 1.0)
    go(aside, 0.7)
    scale = np.array([width / 640, height / 480])
    center, half = np.array(frames) * scale, size * scale / 2
    boxes = np.concatenate([center - half, center + half], axis=2)
    return Story(boxes, (*ends,), fps, width, height)


def _laid_out(rng, size):
    """Centres of things that lie on the table and do not touch, at 640 x 480."""
    low, high = _MARGIN * np.array([640, 480]), (1 - _MARGIN) * np.array([640, 480])
    while True:
        place = rng.uniform(low, high, (len(size), 2))
        apart = np.abs(place[:, None] - place) - (size[:, None] + size) / 2
        if (apart.max(axis=-1) + 1e9 * np.eye(len(size)) > 12).all():
            return place


def painted(told, recipe="lid on pot", seed=0):
    """The frames of a story, RGB."""
    rng = np.random.default_rng([seed, 8])
    names, (height, width) = names_of(recipe), (told.height, told.width)
    rows, columns = np.mgrid[:height, :width]
    tile = np.maximum(rows % 60 < 3, columns % 60 < 3)
    shade = rng.normal(0, 9, (height // 60 + 1, width // 60 + 1))[rows // 60, columns // 60]
    ground = np.array([186, 178, 160]) + shade[..., None] - 40 * tile[..., None]
    coats = [_coat(rng, size) for size in np.round(told.boxes[0, :, 2:] - told.boxes[0, :, :2])]
    slope = (columns / width - 0.5)[..., None]
    for number, boxes in enumerate(told.boxes):
        picture = ground.astype(np.float32).copy()
        for which in range(len(names)):
            _paste(picture, *coats[which], boxes[which])
        moment = number / told.fps
        light = 0.9 + 0.15 * np.cos(moment / 2 + seed) + 0.25 * slope * np.sin(moment / 3)
        noise = rng.normal(0, 6, (height // 2, width // 2, 3)).astype(np.float32)
        noise = cv2.resize(noise, (width, height), interpolation=cv2.INTER_NEAREST)
        yield np.clip(picture * light + noise, 0, 255).astype(np.uint8)


def _coat(rng, size):
    """A thing's picture and the mask of its outline: a blob of two colours with stripes."""
    width, height = (max(4, int(side)) for side in size)
    y, x = np.mgrid[:height, :width]
    u, v = (x + 0.5) / width * 2 - 1, (y + 0.5) / height * 2 - 1
    mask = np.abs(u) ** 4 + np.abs(v) ** 4 < 1
    one, other = rng.uniform(20, 235, (2, 3))
    stripes = np.sin(rng.uniform(4, 9) * (u * np.cos(k := rng.uniform(0, 3)) + v * np.sin(k))) > 0
    return np.where(stripes[..., None], one, other).astype(np.float32), mask


def _paste(picture, coat, mask, box):
    left, top = np.round(box[:2]).astype(int)
    height, width = mask.shape
    low = np.maximum([top, left], 0)
    high = np.minimum([top + height, left + width], picture.shape[:2])
    if (high <= low).any():
        return
    part = slice(low[0] - top, high[0] - top), slice(low[1] - left, high[1] - left)
    picture[low[0] : high[0], low[1] : high[1]][mask[part]] = coat[part][mask[part]]


def tracked(told, faults=Faults(), seed=0):
    """Rows of MOTChallenge, classes numbered from 1, as a tracker reports them."""
    rng = np.random.default_rng([seed, 9])
    boxes, (length, number) = told.boxes.copy(), told.boxes.shape[:2]
    error = rng.normal(0, 1, boxes.shape)
    for t in range(1, length):
        keep = faults.lasting
        error[t] = keep * error[t - 1] + np.sqrt(1 - keep**2) * error[t]
    boxes += faults.jitter * error
    boxes[..., 2:] = np.maximum(boxes[..., 2:], boxes[..., :2] + 4)
    seen = np.ones((length, number), bool)
    for which in range(number):
        seen[: int(rng.uniform(0, faults.late) * told.fps), which] = False
        for t in np.flatnonzero(rng.uniform(size=length) < faults.dropped / faults.burst):
            seen[t : t + 1 + rng.poisson(faults.burst - 1), which] = False
    if faults.hidden:
        seen[:, :-1] &= _covered(told.boxes) < faults.hidden
    track = np.tile(np.arange(1, number + 1), (length, 1))
    for t in np.flatnonzero(rng.uniform(size=length) < faults.switched):
        center = told.boxes[t].reshape(number, 2, 2).mean(axis=1)
        apart = np.linalg.norm(center[:, None] - center, axis=-1) + 1e9 * np.eye(number)
        one, other = np.unravel_index(np.argmin(apart), apart.shape)
        boxes[t, [one, other]] = boxes[t, [other, one]]
        track[t:, one] += number
    extra = 1000
    for t in range(length):
        for which in np.flatnonzero(seen[t]):
            (left, top), (right, low) = boxes[t, which].reshape(2, 2)
            if right > 0 and low > 0 and left < told.width and top < told.height:
                yield _row(t, track[t, which], boxes[t, which], rng.uniform(0.5, 1), which)
        if rng.uniform() < faults.spurious:
            extra += 1
            corner = rng.uniform(0, 0.8, 2) * [told.width, told.height]
            yield _row(t, extra, [*corner, *(corner + 40)], 0.3, rng.integers(number - 1))


def _row(t, track, box, sure, which):
    left, top, right, low = np.round(box, 2).tolist()
    size = f"{right - left:.2f},{low - top:.2f}"
    return f"{t + 1},{track},{left:.2f},{top:.2f},{size},{sure:.2f},{which + 1},1"


def _covered(boxes):
    """The share of each thing's box that is under the hand's."""
    low = np.maximum(boxes[:, :-1, :2], boxes[:, -1:, :2])
    high = np.minimum(boxes[:, :-1, 2:], boxes[:, -1:, 2:])
    common = np.prod(np.maximum(high - low, 0), axis=-1)
    return common / np.prod(boxes[:, :-1, 2:] - boxes[:, :-1, :2], axis=-1)


def write_films(
    folder, count=12, *, recipe="lid on pot", faults=Faults(), seed=0, films=True, **look
):
    """Films, boxes and names in a new folder, and in `first.json` the box of each object on the
    first frame that shows it whole; the stories by their names."""
    folder.mkdir(parents=True, exist_ok=True)
    names, stories, first = names_of(recipe), {}, {}
    (folder / "names.txt").write_text("\n".join(names) + "\n")
    for number in range(count):
        told = story(1000 * seed + number, recipe, **look)
        name = f"stove_{number:02d}"
        if films:
            write_video(folder / f"{name}.mp4", painted(told, recipe, number), told.fps)
        rows = tracked(told, faults, 1000 * seed + number)
        (folder / f"{name}.txt").write_text("\n".join(rows) + "\n")
        edges = told.boxes.round(1)
        within = (edges[..., :2] >= 0).all(-1) & (edges[..., 2:] <= [told.width, told.height]).all(
            -1
        )
        first[name] = [
            {"class": one, "box": edges[frame, which].tolist(), "frame": frame}
            for which, one in enumerate(names)
            for frame in [int(np.argmax(within[:, which]))]
        ]
        stories[name] = told
    (folder / "first.json").write_text(json.dumps(first))
    return stories
