"""Tracks the blocks of one colour through a video.

Pixels are measured between pixel centres, x right and y down; `scale` is pixels per world unit.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.optimize import linear_sum_assignment

from .landmarks import Sighting
from .palette import BLOCK_SHAPES
from .shape_fit import (
    Pose,
    angle_of,
    expected_area,
    fit_blob,
    roundness_of,
    shape_outline,
    true_roundness,
)

_AREA_SLACK = 0.2  # a mask this much off a shape's area is another shape, a part, or two blocks
_ROUNDNESS_SLACK = 0.06
_SEEN = 0.55  # least match of a fitted outline that counts as a sighting
_FAR = 10.0  # cost of an impossible pairing, in world units


class _Component(NamedTuple):
    area: float  # pixels
    center: Float[np.ndarray, "2"]
    roundness: float
    mask: UInt8[np.ndarray, "h w"]  # cut out around it
    corner: tuple[int, int]  # of the cut-out in the frame: x, y


def _components(
    mask: UInt8[np.ndarray, "H W"], scale: float
) -> tuple[list[_Component], UInt8[np.ndarray, "H W"]]:
    """Parts of a mask that may each be one whole block, and the mask of the rest."""
    left, top, width, height = cv2.boundingRect(mask)
    if width == 0:
        return [], mask
    _, parts, stats, centroids = cv2.connectedComponentsWithStats(
        np.ascontiguousarray(mask[top : top + height, left : left + width]), connectivity=4
    )
    rest, found = mask.copy(), []
    smallest = (1 - _AREA_SLACK) * min(map(expected_area, BLOCK_SHAPES)) * scale**2
    largest = (1 + _AREA_SLACK) * max(map(expected_area, BLOCK_SHAPES)) * scale**2
    for i, (x, y, width, height, area) in enumerate(stats.tolist()):
        if i == 0 or area > largest:
            continue
        window = (slice(y, y + height), slice(x, x + width))
        part = (parts[window] == i).astype(np.uint8)
        if area >= smallest:
            center = centroids[i] + [left, top]
            corner = (left + x, top + y)
            found.append(_Component(area, center, roundness_of(part), part, corner))
        if area >= smallest or area < 0.1 * smallest:  # crumbs belong to nobody
            rest[top:, left:][window][part > 0] = 0
    return found, rest


def _mismatch(component: _Component, shape: str, scale: float) -> float:
    """Mismatch of a shape: 0 for a perfect example, 1 at the limit of acceptance."""
    area = abs(component.area / (expected_area(shape) * scale**2) - 1) / _AREA_SLACK
    roundness = abs(component.roundness - true_roundness(shape)) / _ROUNDNESS_SLACK
    return max(area, roundness)


def count_shapes(masks: Sequence[UInt8[np.ndarray, "H W"]], scale: float) -> dict[str, int]:
    """The number of blocks of each shape, from masks of one colour in several frames.

    A shape counts as often as it stands alone in at least a quarter of the frames.
    """
    tallies: dict[str, Counter] = {shape: Counter() for shape in BLOCK_SHAPES}
    for mask in masks:
        components, _ = _components(mask, scale)
        kinds = Counter()
        for component in components:
            shape = min(BLOCK_SHAPES, key=lambda s: _mismatch(component, s, scale))
            if _mismatch(component, shape, scale) <= 1:
                kinds[shape] += 1
        for shape, number in kinds.items():
            tallies[shape].update(range(1, number + 1))
    enough = len(masks) / 4
    return {
        shape: max((n for n, times in tally.items() if times >= enough), default=0)
        for shape, tally in tallies.items()
    }


class BlockTracker:
    """Tracks the blocks of one colour: assigns masks to blocks, from frame to frame.

    Whole masks are paired with blocks by distance from the last position, and by shape. Blocks
    that find none look for their outline in what is left of the mask, where blocks that touch
    are one blob. `unknown` pixels are always of this colour, such as dashes of a goal.
    """

    def __init__(
        self, shapes: list[str], scale: float, unknown: Bool[np.ndarray, "H W"] | None = None
    ):
        self.shapes = shapes
        self.scale = scale
        self._unknown = unknown
        self._poses: list[Pose | None] = [None] * len(shapes)
        self._last: list[np.ndarray | None] = [None] * len(shapes)

    def update(self, mask: UInt8[np.ndarray, "H W"]) -> list[Sighting | None]:
        """Reads the next frame's mask; None for a block that cannot be seen."""
        components, rest = _components(mask, self.scale)
        found = {i: self._measure(i, component) for i, component in self._pairs(components)}
        found |= self._fit(rest, [i for i in range(len(self.shapes)) if i not in found])
        for i, sighting in found.items():
            self._last[i] = sighting.center
        return [found.get(i) for i in range(len(self.shapes))]

    def _pairs(self, components: list[_Component]) -> list[tuple[int, _Component]]:
        if not components:
            return []
        cost = np.array([[self._cost(i, c) for c in components] for i in range(len(self.shapes))])
        rows, columns = linear_sum_assignment(cost)
        return [
            (int(i), components[j]) for i, j in zip(rows, columns, strict=True) if cost[i, j] < _FAR
        ]

    def _cost(self, i: int, component: _Component) -> float:
        """World units from the last position; a wrong shape adds up to a block's width."""
        area = component.area / (expected_area(self.shapes[i]) * self.scale**2)
        if abs(area - 1) > _AREA_SLACK:
            return _FAR
        unlike = min(_mismatch(component, self.shapes[i], self.scale), 4.0)
        last = self._last[i]
        travel = 0.0 if last is None else float(np.linalg.norm(component.center - last))
        return travel / self.scale + 0.1 * unlike

    def _measure(self, i: int, component: _Component) -> Sighting:
        """Measures a separate block: its centroid, or its fitted outline beside dashes."""
        angle = angle_of(component.mask, self.shapes[i])
        self._poses[i] = Pose(*component.center.tolist(), angle, 1.0)
        height, width = component.mask.shape
        x, y = component.corner
        if self._unknown is not None and self._unknown[y : y + height, x : x + width].any():
            alone = np.zeros(self._unknown.shape, np.uint8)
            alone[y : y + height, x : x + width] = component.mask
            if fitted := self._fit(alone, [i]):
                return fitted[i]
        growth = math.sqrt(component.area / (expected_area(self.shapes[i]) * self.scale**2))
        return Sighting(component.center, self._box(i, angle) * growth)

    def _fit(self, rest: UInt8[np.ndarray, "H W"], lost: list[int]) -> dict[int, Sighting]:
        """Blocks whose outline fits into a mask, by their number."""
        if not lost or not rest.any():
            return {}
        x, y, width, height = cv2.boundingRect(rest)
        corner, found = np.array([x, y], float), {}
        poses = (self._poses[i] for i in lost)
        previous = [pose and pose._replace(x=pose.x - x, y=pose.y - y) for pose in poses]
        shapes = [self.shapes[i] for i in lost]
        window = (slice(y, y + height), slice(x, x + width))
        unknown = None if self._unknown is None else self._unknown[window]
        poses = fit_blob(rest[window], shapes, previous, self.scale, unknown=unknown)
        for i, pose in zip(lost, poses, strict=True):
            if pose.match < _SEEN:
                self._poses[i] = None
                continue
            self._poses[i] = pose._replace(x=pose.x + x, y=pose.y + y)
            center = corner + np.array([pose.x, pose.y])
            found[i] = Sighting(center, self._box(i, pose.angle))
        return found

    def _box(self, i: int, angle: float) -> Float[np.ndarray, "2"]:
        """Box of the turned outline, since the few mixed pixels at a tip would make it jump."""
        corners = shape_outline(self.shapes[i]) * self.scale
        cos, sin = math.cos(angle), math.sin(angle)
        return np.ptp(corners @ np.array([[cos, sin], [-sin, cos]]), axis=0)
