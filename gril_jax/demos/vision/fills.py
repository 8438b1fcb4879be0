"""Detects the objects of MAGICAL's tasks by their fills: regions, and blocks that touch.

A block's outline is darker than its fill and keeps two that touch apart, also after a codec. Blocks
hide neither each other nor the robot, so each is one part of its colour's fill in every frame.
Blocks of the same colour are told apart by where they were one frame before.
World coordinates have their origin in the middle of the frame and y up; T is frames, N objects.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from scipy.optimize import linear_sum_assignment

from gril_jax.demos.demo import Tracks
from gril_jax.errors import DemoError

from .detect import SAMPLES, in_world
from .landmarks import find_regions, find_robot
from .palette import BLOCK_COLOURS, BLOCK_SHAPES, SUITE_CLASSES, block_code, classify, fills
from .shape_fit import angle_of, expected_area, shape_outline, symmetry_of, true_symmetry

_PART = 0.4, 1.25  # of the smallest and the largest block's area: fills of one block lie between
_FAR = 0.25  # world units that no block moves in a frame
_VOTES = 24  # frames, spread over a video, in which the shape of a block is read


class _Part(NamedTuple):
    """One fill in one frame; pixels."""

    area: float
    center: Float[np.ndarray, "2"]
    mask: UInt8[np.ndarray, "h w"]  # cut out around it


@dataclass(frozen=True)
class FillDetector:
    """Finds robot, regions and blocks, whatever there is of them, by colour and shape."""

    half_extent: float = 1.02  # world units: half of a frame's width
    classes: Sequence[str] = SUITE_CLASSES

    def detect(self, frames: UInt8[np.ndarray, "T H W 3"], *, name: str = "video") -> Tracks:
        """Boxes of all objects in all frames, in the order of the class names.

        Those of one class are ordered from left to right in the first frame. An object that is lost
        in a frame keeps its last box. No frame, no robot, or a block whose number changes in more
        than half of the frames is a DemoError.
        """
        if len(frames) == 0:
            raise DemoError(f"{name}: the video holds no frames, at least 1 is needed.")
        scale = frames.shape[2] / (2 * self.half_extent)
        picks = np.unique(np.linspace(0, len(frames) - 1, SAMPLES).round().astype(int))
        regions = find_regions(np.stack([classify(frames[i]) for i in picks]), scale)
        robot = [find_robot(classify(frame), scale) for frame in frames]
        if not any(robot):
            raise DemoError(f"{name}: no robot is to be seen in any of {len(frames)} frames.")
        shown = np.array([one is not None for one in robot])
        none = np.zeros(2)
        found = [("robot", np.array([one.center if one else none for one in robot]),
                  np.array([one.size if one else none for one in robot]), shown)]  # fmt: skip
        for region in regions:
            box = [np.tile(x, (len(frames), 1)) for x in (region.center, region.size)]
            found.append((f"{region.colour} region", *box, np.ones(len(frames), bool)))
        codes = [fills(frame) for frame in frames]
        for colour in BLOCK_COLOURS:
            found += _blocks(codes, colour, scale, name)
        found.sort(key=lambda one: (self.classes.index(one[0]), one[1][0, 0]))
        center, size, seen = (np.stack([one[k] for one in found], 1) for k in (1, 2, 3))
        label = [self.classes.index(one[0]) for one in found]
        return in_world(center, size, seen, label, frames.shape[1:3], scale)


def _blocks(codes: list[np.ndarray], colour: str, scale: float, name: str) -> list[tuple]:
    """(class, centres (T, 2), sizes (T, 2), seen (T,)) of the blocks of one colour, in pixels."""
    parts = [_parts(frame, colour, scale) for frame in codes]
    number, times = Counter(map(len, parts)).most_common(1)[0]
    if 2 * times < len(codes):
        raise DemoError(
            f"{name}: the number of {colour} blocks changes: {number} are to be seen in only "
            f"{times} of {len(codes)} frames."
        )
    follow = _followed(parts, number, scale)
    return [_block([each[k] for each in follow], colour, scale) for k in range(number)]


def _parts(codes: UInt8[np.ndarray, "H W"], colour: str, scale: float) -> list[_Part]:
    mask = cv2.compare(codes, block_code(colour), cv2.CMP_EQ)
    _, parts, stats, centers = cv2.connectedComponentsWithStats(mask, connectivity=4)
    least = _PART[0] * min(map(expected_area, BLOCK_SHAPES)) * scale**2
    most = _PART[1] * max(map(expected_area, BLOCK_SHAPES)) * scale**2
    found = []
    for i, (x, y, width, height, area) in enumerate(stats.tolist()):
        if i and least < area < most:  # dashes of a region are smaller
            cut = (parts[y : y + height, x : x + width] == i).astype(np.uint8)
            found.append(_Part(area, centers[i], cut))
    return found


def _followed(parts: list[list[_Part]], number: int, scale: float) -> list[list[_Part | None]]:
    """The parts of each frame in the order of the first whole frame's; None for what is lost."""
    first = next(t for t, found in enumerate(parts) if len(found) == number)
    order: list[list[_Part | None]] = [[] for _ in parts]
    for frames in (range(first, len(parts)), range(first, -1, -1)):
        last = np.array([part.center for part in parts[first]]).reshape(number, 2)
        for t in frames:
            order[t] = [None] * number
            there = np.array([part.center for part in parts[t]]).reshape(-1, 2)
            away = np.linalg.norm(last[:, None] - there, axis=-1)
            for i, j in zip(*linear_sum_assignment(away), strict=True):
                if away[i, j] < _FAR * scale:
                    order[t][i], last[i] = parts[t][j], there[j]
    return order


def _block(parts: list[_Part | None], colour: str, scale: float) -> tuple:
    seen = np.array([part is not None for part in parts])
    whole = [part for part in parts if part is not None]
    picks = np.unique(np.linspace(0, len(whole) - 1, _VOTES).round().astype(int))
    shape = Counter(_shape(whole[i]) for i in picks).most_common(1)[0][0]
    corners = shape_outline(shape) * scale
    center, size = np.zeros((len(parts), 2)), np.zeros((len(parts), 2))
    for t, part in enumerate(parts):
        if part is not None:
            angle = angle_of(part.mask, shape)
            cos, sin = np.cos(angle), np.sin(angle)
            center[t], size[t] = part.center, np.ptp(corners @ [[cos, sin], [-sin, cos]], axis=0)
    return f"{colour} {shape}", center, size, seen


def _shape(part: _Part) -> str:
    """The shape with the nearest symmetry."""
    found = symmetry_of(part.mask)
    return min(BLOCK_SHAPES, key=lambda shape: np.linalg.norm(found - true_symmetry(shape)))
