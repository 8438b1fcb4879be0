"""Finds known shapes in a mask: outlines of the blocks, shape recognition and pose fitting.

Blocks of one colour that touch are one blob: each block's outline is moved and turned until the
outlines together cover it. Positions are in pixels between pixel centres, x right and y down.
"""

import functools
import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

_SIZE = 0.12  # world units: the blocks' common scale (0.6 x the robot's radius)
_SQUARE_SIDE = math.sqrt(math.pi) * _SIZE
_PENTAGON_SIDE = 0.1622
_CORNERS = {  # their distances from the centre of mass, in turn, and their number
    "star": ([1.3 * _SIZE, 0.65 * _SIZE], 10),
    "square": ([_SQUARE_SIDE / math.sqrt(2)], 4),
    "pentagon": ([_PENTAGON_SIDE / (2 * math.sin(math.pi / 5))], 5),
    "circle": ([_SIZE], 48),
}
_FOLD = {"star": 5, "pentagon": 5, "square": 4, "circle": 0}  # rotational symmetry
_GOOD = 0.8  # covered share of a shape from which a fit needs no wider search


class Pose(NamedTuple):
    """One fitted shape."""

    x: float  # pixels
    y: float
    angle: float  # radians
    match: float  # 1: the shape covers mask only; 0 or less: no better than nothing


@functools.cache
def shape_outline(shape: str) -> Float[np.ndarray, "K 2"]:
    """A block's corners around its centre of mass, in world units."""
    radii, corners = _CORNERS[shape]
    turn = 2 * np.pi * np.arange(corners) / corners
    return np.resize(radii, corners)[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)


@functools.cache
def expected_area(shape: str) -> float:
    """A block's area in square world units."""
    x, y = shape_outline(shape).T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


@functools.cache
def true_roundness(shape: str) -> float:
    """Largest radius over the radius of the disc of equal area: 1 circle, 1.15, 1.25, 1.46."""
    corners = shape_outline(shape)
    farthest = float(np.linalg.norm(corners, axis=-1).max())
    return 1.0 if shape == "circle" else farthest / math.sqrt(expected_area(shape) / math.pi)


def roundness_of(mask: UInt8[np.ndarray, "H W"]) -> float:
    """`true_roundness` measured on a mask: mean over the four farthest parts of its rim."""
    rims, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    rim = max(rims, key=len)[:, 0].astype(np.float64)
    moments = cv2.moments(mask, binaryImage=True)
    offset = rim - [moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]]
    sector = ((np.arctan2(offset[:, 1], offset[:, 0]) + np.pi) / (2 * np.pi) * 4.999).astype(int)
    radius = np.linalg.norm(offset, axis=-1) + 0.5  # rim pixels are centres, the edge is outside
    farthest = [radius[sector == k].max() for k in range(5) if (sector == k).any()]
    return float(np.mean(sorted(farthest)[-4:]) / math.sqrt(moments["m00"] / math.pi))


def symmetry_of(mask: UInt8[np.ndarray, "H W"]) -> Float[np.ndarray, "2"]:
    """The fourfold and the fivefold symmetry of a mask, each from 0 to 1.

    For z = x + iy from the centre, it is |sum of z^n| over the sum of |z|^n, for n = 4 and 5. Every
    pixel counts, so a rim that compression has frayed changes little.
    """
    y, x = np.nonzero(mask)
    z = (x - x.mean()) + 1j * (y - y.mean())
    return np.array([abs((z**n).sum()) / max((abs(z) ** n).sum(), 1e-9) for n in (4, 5)])


@functools.cache
def true_symmetry(shape: str) -> tuple[float, float]:
    """`symmetry_of` a block: near (0, 0.77) for a star, (0.43, 0), (0, 0.31) and (0, 0)."""
    mask = np.zeros((500, 500), np.uint8)
    cv2.fillPoly(mask, [(250 + 1500 * shape_outline(shape)).round().astype(np.int32)], 1)
    fourth, fifth = symmetry_of(mask).tolist()
    return fourth, fifth


def angle_of(mask: UInt8[np.ndarray, "H W"], shape: str) -> float:
    """The angle of a whole shape, in radians, from the phase of its n-th moment.

    For a shape with n-fold symmetry, the sum of (z - centre)^n over its pixels z = x + iy turns
    n times as fast as the shape does.
    """
    fold = _FOLD[shape]
    if not fold:
        return 0.0
    y, x = np.nonzero(mask)
    z = (x - x.mean()) + 1j * (y - y.mean())
    fourth = (z * z) ** 2
    return float(np.angle((fourth if fold == 4 else fourth * z).sum())) / fold


def fit_blob(
    mask: UInt8[np.ndarray, "H W"],
    shapes: list[str],
    previous: list[Pose | None],
    scale: float,
    *,
    unknown: Bool[np.ndarray, "H W"] | None = None,
) -> list[Pose]:
    """Poses of shapes that together cover a mask, 1 where the blocks' colour is.

    `previous` are their poses in the frame before, as far as they are known. `scale` is in pixels
    per world unit, and `unknown` marks pixels whose colour says nothing about blocks.
    """
    field = _Field(mask, scale, unknown)
    poses = [
        None if pose is None else field.refine(shape, pose, [])
        for shape, pose in zip(shapes, previous, strict=True)
    ]
    poses = [pose if pose is not None and pose.match > _GOOD else None for pose in poses]
    while None in poses:  # the clearest of the shapes still to be found goes first
        placed = [(s, p) for s, p in zip(shapes, poses, strict=True) if p is not None]
        found = {i: field.search(shapes[i], placed) for i, pose in enumerate(poses) if pose is None}
        best = max(found, key=lambda i: found[i].match)
        poses[best] = found[best]
    for _ in range(2):
        for i, shape in enumerate(shapes):
            others = [(s, p) for j, (s, p) in enumerate(zip(shapes, poses, strict=True)) if j != i]
            poses[i] = field.refine(shape, poses[i], others)
    return poses


class _Field:
    """Scores of a mask to lay shapes on: +1 in the mask, 0 where unknown, -1 elsewhere."""

    def __init__(
        self, mask: UInt8[np.ndarray, "H W"], scale: float, unknown: Bool[np.ndarray, "H W"] | None
    ):
        self.scale = scale
        self.pad = math.ceil(0.2 * scale)
        value = mask.astype(np.float32) * 2 - 1
        if unknown is not None:
            value[unknown] = 0.0
        self.value = cv2.copyMakeBorder(value, *[self.pad] * 4, cv2.BORDER_CONSTANT, value=-1.0)

    def search(self, shape: str, others: list[tuple[str, Pose]]) -> Pose:
        """Finds the best pose in the mask: every position at a few angles, then refined."""
        value = self._without(others)
        fold = _FOLD[shape]
        best = (-np.inf, 0.0, 0.0, 0.0)
        half = math.ceil(0.17 * self.scale)
        for k in range(8 if fold else 1):
            angle = 2 * math.pi * k / (8 * max(fold, 1))
            stencil = self._coverage(shape, float(half), float(half), angle, 2 * half + 1)
            response = cv2.matchTemplate(value, stencil, cv2.TM_CCORR)
            _, peak, _, (x, y) = cv2.minMaxLoc(response)
            best = max(best, (peak, float(x + half - self.pad), float(y + half - self.pad), angle))
        return self.refine(shape, Pose(best[1], best[2], best[3], 0.0), others)

    def refine(self, shape: str, pose: Pose, others: list[tuple[str, Pose]]) -> Pose:
        """Refines a pose by pattern search, from 2 pixels and 8 degrees to an eighth of a pixel."""
        value = self._without(others)
        at = np.array([pose.x, pose.y, pose.angle])
        unit = np.array([1.0, 1.0, np.radians(4.0) if _FOLD[shape] else 0.0])
        score = self._score(value, shape, at)
        step = 2.0
        while step >= 0.125:
            improved = False
            for axis in range(3 if _FOLD[shape] else 2):
                for sign in (1, -1):
                    trial = at.copy()
                    trial[axis] += sign * step * unit[axis]
                    trial_score = self._score(value, shape, trial)
                    if trial_score > score + 1e-3:
                        at, score, improved = trial, trial_score, True
                        break
            if not improved:
                step /= 2
        match = score / (expected_area(shape) * self.scale**2)
        return Pose(float(at[0]), float(at[1]), float(at[2]), float(match))

    def _without(self, others: list[tuple[str, Pose]]) -> Float32[np.ndarray, "H W"]:
        """The field with pixels that other shapes cover counted as outside the mask."""
        value = self.value.copy()
        for shape, pose in others:
            window, x, y = self._window(pose.x, pose.y)
            if window is not None:
                view, cover = value[window], self._coverage(shape, x, y, pose.angle, self._side)
                view[...] = np.where(view > -1, view - 2 * cover, view)
        return value

    @property
    def _side(self) -> int:
        return 2 * math.ceil(0.17 * self.scale) + 3

    def _window(self, x: float, y: float):
        """Slices of the padded field around a position, and the position within them."""
        left = math.floor(x) + self.pad - self._side // 2
        top = math.floor(y) + self.pad - self._side // 2
        height, width = self.value.shape
        if left < 0 or top < 0 or left + self._side > width or top + self._side > height:
            return None, 0.0, 0.0
        window = (slice(top, top + self._side), slice(left, left + self._side))
        return window, x + self.pad - left, y + self.pad - top

    def _score(self, value: np.ndarray, shape: str, at: np.ndarray) -> float:
        window, x, y = self._window(at[0], at[1])
        if window is None:
            return -np.inf
        return float((value[window] * self._coverage(shape, x, y, at[2], self._side)).sum())

    def _coverage(
        self, shape: str, x: float, y: float, angle: float, side: int
    ) -> Float32[np.ndarray, "S S"]:
        """The share of each pixel that a shape covers, 0 to 1; smooth in the pose."""
        field, middle = _distance_field(shape, self.scale)
        cos, sin = math.cos(angle), math.sin(angle)
        # Output pixel (u, v) reads the field at R^T (u - x, v - y) + middle.
        inverse = np.array(
            [[cos, sin, middle - cos * x - sin * y], [-sin, cos, middle + sin * x - cos * y]]
        )
        flags, border = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, cv2.BORDER_REPLICATE
        distance = cv2.warpAffine(field, inverse, (side, side), flags=flags, borderMode=border)
        return np.clip(distance + 0.5, 0.0, 1.0, out=distance)


@functools.lru_cache(maxsize=16)
def _distance_field(shape: str, scale: float) -> tuple[Float32[np.ndarray, "S S"], float]:
    """Signed distance to a shape's edge in pixels (inside positive), and its middle's index."""
    half = math.ceil(0.25 * scale)
    side = 2 * half + 1
    contour = (shape_outline(shape) * scale + half).astype(np.float32)[:, None]
    at = [[(float(x), float(y)) for x in range(side)] for y in range(side)]
    field = [[cv2.pointPolygonTest(contour, point, True) for point in row] for row in at]
    return np.array(field, np.float32), float(half)
