"""Detects object boxes in world units from frames.

`ColourDetector` reads the flat palette of MAGICAL and x-magical; anything else that implements
`Detector` can take its place.
World coordinates have their origin in the middle of the frame and y up; T is frames, N objects.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from gril_jax.demos.demo import Tracks
from gril_jax.errors import DemoError

from .block_tracks import BlockTracker, count_shapes
from .landmarks import Goal, find_goal, find_robot, without_dashes
from .palette import BLOCK_COLOURS, PALETTE_CLASSES, block_code, classify

SAMPLES = 16  # frames, spread over a video, from which the goal and the set of blocks are read
_SLACK = 0.3  # pixels: what the codec's edges move a resting block's centre and box


@runtime_checkable
class Detector(Protocol):
    """Anything that finds the same objects in every frame of a video."""

    classes: Sequence[str]  # a label is an index into them
    half_extent: float  # world units: half the width of the world that a frame shows

    def detect(self, frames: UInt8[np.ndarray, "T H W 3"], *, name: str = "video") -> Tracks:
        """Boxes of all objects in all frames; errors are `DemoError`s that give `name`."""


@dataclass(frozen=True)
class ColourDetector:
    """Finds goal, robot and blocks of the MAGICAL / x-magical palette by colour and shape.

    Without `objects` it takes what there is: the blocks that stand alone in a quarter of the
    video, and the goal and robot.
    """

    classes: Sequence[str] = PALETTE_CLASSES  # those that are not of the palette are never found
    half_extent: float = 1.02  # world units: half of a frame's width; 1.122 for x-magical
    objects: Sequence[str] | None = None  # that a video holds; a name may come twice

    def __post_init__(self):
        for name in self.objects or ():
            if name not in self.classes or name not in PALETTE_CLASSES:
                raise DemoError(
                    f"objects: {name!r} is not one of the classes that colours tell apart: "
                    f"{', '.join(c for c in self.classes if c in PALETTE_CLASSES)}."
                )

    def detect(self, frames: UInt8[np.ndarray, "T H W 3"], *, name: str = "video") -> Tracks:
        """Boxes of all objects in all frames, in the order of the class names.

        An object that cannot be seen in a frame keeps its last box (before its first sighting:
        its first). Centres and boxes follow with a slack of 0.3 pixels, so that what rests in
        the world rests in the tracks. No frame or goal region, or an object that is never seen, is
        a DemoError.
        """
        if len(frames) == 0:
            raise DemoError(f"{name}: the video holds no frames, at least 1 is needed.")
        height, width = frames.shape[1:3]
        scale = width / (2 * self.half_extent)
        picks = np.unique(np.linspace(0, len(frames) - 1, SAMPLES).round().astype(int))
        samples = np.stack([classify(frames[i]) for i in picks])
        goal = find_goal(samples, scale)
        if goal is None:
            raise DemoError(
                f"{name}: no goal region was found; it should be a pale rectangle of a block's "
                "colour that at least a quarter of the frames show."
            )
        objects = self._inventory(samples, goal, scale)
        center, size, seen = _follow(frames, objects, goal, scale)
        for i, class_name in enumerate(objects):
            if not seen[:, i].any():
                raise DemoError(
                    f"{name}: the object {class_name!r} is not to be seen in any of "
                    f"{len(frames)} frames."
                )
        label = [self.classes.index(name) for name in objects]
        return in_world(center, size, seen, label, (height, width), scale)

    def _inventory(self, samples: np.ndarray, goal: Goal, scale: float) -> list[str]:
        if self.objects is not None:
            return sorted(self.objects, key=self.classes.index)
        objects = [name for name in ("goal", "robot") if name in self.classes]
        for colour in BLOCK_COLOURS:
            masks = [_mask(codes, colour, goal, scale) for codes in samples]
            for shape, number in count_shapes(masks, scale).items():
                if f"{colour} {shape}" in self.classes:
                    objects += [f"{colour} {shape}"] * number
        return sorted(objects, key=self.classes.index)


def _mask(
    codes: UInt8[np.ndarray, "H W"], colour: str, goal: Goal, scale: float
) -> UInt8[np.ndarray, "H W"]:
    mask = cv2.compare(codes, block_code(colour), cv2.CMP_EQ) & 1
    return without_dashes(mask, goal, scale) if colour == goal.colour else mask


def _follow(
    frames: np.ndarray, objects: list[str], goal: Goal, scale: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres and sizes in pixels, and a mask of the frames with a sighting; zeros elsewhere."""
    center = np.zeros((len(frames), len(objects), 2))
    size = np.zeros_like(center)
    seen = np.zeros(center.shape[:2], bool)
    trackers = []
    for colour in BLOCK_COLOURS:
        mine = [i for i, name in enumerate(objects) if name.startswith(f"{colour} ")]
        shapes = [objects[i].split()[1] for i in mine]
        dashes = goal.dashes if colour == goal.colour else None
        if mine:
            trackers.append((colour, mine, BlockTracker(shapes, scale, dashes)))
    for t, frame in enumerate(frames):
        codes = classify(frame)
        sightings = {}
        for colour, mine, tracker in trackers:
            found = tracker.update(_mask(codes, colour, goal, scale))
            sightings |= dict(zip(mine, found, strict=True))
        for i, name in enumerate(objects):
            if name == "goal":
                sightings[i] = goal
            elif name == "robot":
                sightings[i] = find_robot(codes, scale)
        for i, sighting in sightings.items():
            if sighting is not None:
                center[t, i], size[t, i], seen[t, i] = sighting.center, sighting.size, True
    return center, size, seen


def carried(
    tracks: Float[np.ndarray, "T N K"], seen: Bool[np.ndarray, "T N"]
) -> Float[np.ndarray, "T N K"]:
    """Tracks with the last sighting in unseen frames; frames before the first get the first."""
    source = np.maximum.accumulate(np.where(seen, np.arange(len(seen))[:, None], -1))
    source = np.where(source < 0, seen.argmax(0), source)
    return np.take_along_axis(tracks, source[..., None], axis=0)


def in_world(
    center: Float[np.ndarray, "T N 2"],
    size: Float[np.ndarray, "T N 2"],
    seen: Bool[np.ndarray, "T N"],
    label: Sequence[int],
    shape: tuple[int, int],
    scale: float,
) -> Tracks:
    """Tracks in world units of sightings in pixels, in frames of a height and width.

    They have no gaps, and rest where they move less than the codec's slack."""
    center, size = carried(center, seen), carried(size, seen)
    for track in (*np.moveaxis(center, 1, 0), *np.moveaxis(size, 1, 0)):
        hold(track)
    middle = np.array([(shape[1] - 1) / 2, (shape[0] - 1) / 2])
    world = ((center - middle) / scale * [1.0, -1.0]).astype(np.float32)
    return Tracks(world, (size / scale).astype(np.float32), np.array(label, np.int32), seen)


def hold(track: np.ndarray) -> None:
    """Smooths a track like a cart on a slack rope: it rests until the rope is taut.

    A plain dead band would jump by its whole width when noise crosses it."""
    for t in range(1, len(track)):
        pull = track[t] - track[t - 1]
        distance = float(np.linalg.norm(pull))
        track[t] = track[t - 1] + pull * max(0.0, 1 - _SLACK / max(distance, _SLACK))
