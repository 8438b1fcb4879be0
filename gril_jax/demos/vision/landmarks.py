"""Finds regions, fixed for a whole video, and the moving robot, in palette codes.

Positions and boxes are in pixels between pixel centres, x right and y down; `scale` is pixels
per world unit.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from .palette import BLOCK_COLOURS, GREY, block_code, goal_code

_MIN_GOAL_AREA = 0.05  # square world units; the smallest goal of any variant has 0.25
_MIN_GOAL_PART = 0.005
_BORDER = 0.025  # world units: half the width of the band around the edge that holds dashes
_VOTERS = 0.035  # world units: how far around a dash pixel its neighbours vote
_DISC_RADIUS = 0.2
_EYE_AREA = 0.01  # square world units: larger holes, as between closed fingers, stay open
_THIN = 0.035  # world units: half width under which grey is finger, outline or arena wall


class Goal(NamedTuple):
    """A goal region: rectangle with a dashed border, fixed for a whole video."""

    colour: str
    center: Float[np.ndarray, "2"]  # pixels
    size: Float[np.ndarray, "2"]  # pixels, to the middle of the dashed border
    # pixels that are dash, or block over a dash, in nearly all frames
    dashes: Bool[np.ndarray, "H W"]


class Sighting(NamedTuple):
    """The place of a robot's body, or of a block, in one frame."""

    center: Float[np.ndarray, "2"]  # pixels
    size: Float[np.ndarray, "2"]  # pixels, axis-aligned box


def find_goal(codes: UInt8[np.ndarray, "S H W"], scale: float) -> Goal | None:
    """The goal region, from frames spread over a video, or None where there is none.

    A pixel belongs to it if it is pale in a quarter of the frames: others may cover it for a while.
    """
    masks = {colour: _pale(codes, colour) for colour in BLOCK_COLOURS}
    colour = max(masks, key=lambda name: int(masks[name].sum()))
    parts, areas = _parts(masks[colour])
    # A long stick at rest on the goal cuts it in two; flecks are edges of pale and white.
    whole = 1 + np.flatnonzero(areas >= _MIN_GOAL_PART * scale**2)
    region = np.isin(parts, whole)
    if region.sum() < _MIN_GOAL_AREA * scale**2:
        return None
    return _goal(codes, colour, region, scale)


def find_regions(codes: UInt8[np.ndarray, "S H W"], scale: float) -> list[Goal]:
    """All regions of a scene, each of one piece, by colour and then from left to right."""
    found = []
    for colour in BLOCK_COLOURS:
        parts, areas = _parts(_pale(codes, colour))
        whole = 1 + np.flatnonzero(areas >= _MIN_GOAL_AREA * scale**2)
        each = [_goal(codes, colour, parts == part, scale) for part in whole]
        found += sorted(each, key=lambda goal: float(goal.center[0]))
    return found


def _pale(codes: UInt8[np.ndarray, "S H W"], colour: str) -> UInt8[np.ndarray, "H W"]:
    few = max(1, len(codes) // 4)
    return ((codes == goal_code(colour)).sum(0) >= few).astype(np.uint8)


def _parts(mask: UInt8[np.ndarray, "H W"]) -> tuple[np.ndarray, np.ndarray]:
    """The mask's parts, numbered from 1, and their areas in pixels."""
    core = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, parts, stats, _ = cv2.connectedComponentsWithStats(core, connectivity=4)
    return parts, stats[1:, cv2.CC_STAT_AREA]


def _goal(codes: np.ndarray, colour: str, region: Bool[np.ndarray, "H W"], scale: float) -> Goal:
    # Fill shows between the dashes up to the true edge: there, about half of a row is pale.
    x_min, x_max = _extent(region.sum(0))
    y_min, y_max = _extent(region.sum(1))

    # A dash is bare of paint in no frame; a block that rests on the edge came from elsewhere.
    bare = ((codes == 0) | (codes == goal_code(colour))).sum(0)
    dash = (codes == block_code(colour)).any(0) & (bare * 10 <= len(codes))
    dash &= _band(region.shape, (x_min, y_min, x_max, y_max), math.ceil(_BORDER * scale))
    dash = cv2.dilate(dash.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    center = np.array([(x_min + x_max) / 2, (y_min + y_max) / 2])
    size = np.array([x_max - x_min + 1.0, y_max - y_min + 1.0])
    return Goal(colour, center, size, dash)


def _extent(counts: np.ndarray) -> tuple[int, int]:
    inside = np.flatnonzero(counts >= 0.25 * counts.max())
    return int(inside[0]), int(inside[-1])


def _band(
    shape: tuple[int, ...], box: tuple[int, int, int, int], width: int
) -> Bool[np.ndarray, "H W"]:
    x_min, y_min, x_max, y_max = box
    band = np.zeros(shape, np.uint8)
    cv2.rectangle(band, (x_min - width, y_min - width), (x_max + width, y_max + width), 1, -1)
    cv2.rectangle(band, (x_min + width, y_min + width), (x_max - width, y_max - width), 0, -1)
    return band.astype(bool)


def without_dashes(
    mask: UInt8[np.ndarray, "H W"], goal: Goal, scale: float
) -> UInt8[np.ndarray, "H W"]:
    """A mask of the goal's colour without the dashed border, which has the same colour.

    A dash pixel says nothing about blocks: it is kept where most of the pixels around it that
    are not dash are block.
    """
    side = 2 * math.ceil(_VOTERS * scale) + 1
    known = (~goal.dashes).astype(np.float32)
    voters = cv2.boxFilter(known, -1, (side, side), normalize=False)
    votes = cv2.boxFilter(mask * known, -1, (side, side), normalize=False)
    return np.where(goal.dashes, votes > 0.5 * voters, mask).astype(np.uint8)


def find_robot(codes: UInt8[np.ndarray, "H W"], scale: float) -> Sighting | None:
    """The robot's body: the grey disc without its fingers, or else the grey bar of a stick."""
    grey = cv2.compare(codes, np.full_like(codes, GREY), cv2.CMP_EQ) & 1
    side = max(1, int(_THIN * scale))
    thick = cv2.boundingRect(cv2.erode(grey, np.ones((side, side), np.uint8)))
    if thick[2] == 0:
        return None
    left, top = max(thick[0] - side, 0), max(thick[1] - side, 0)  # leaves most arena wall out
    grey = np.ascontiguousarray(
        grey[top : thick[1] + thick[3] + side, left : thick[0] + thick[2] + side]
    )
    _fill_small_holes(grey, _EYE_AREA * scale**2)
    body = _largest(_opened(grey, _THIN * scale))
    if body is None:
        return None
    disc = _largest(_opened(body, 0.75 * _DISC_RADIUS * scale))
    moments = cv2.moments(body if disc is None else disc, binaryImage=True)
    center = [left + moments["m10"] / moments["m00"], top + moments["m01"] / moments["m00"]]
    if disc is not None:
        return Sighting(np.array(center), np.full(2, 2 * _DISC_RADIUS * scale))
    reach = 2 * math.ceil(0.42 * _THIN * scale) + 1  # opening has rounded the stick's corners
    square = cv2.dilate(body, np.ones((reach, reach), np.uint8)) & grey
    return Sighting(np.array(center), np.array(cv2.boundingRect(square)[2:], float))


def _opened(mask: UInt8[np.ndarray, "H W"], radius: float) -> UInt8[np.ndarray, "H W"]:
    """Morphological opening: the union of all discs of this radius inside the mask."""
    bordered = cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    core = cv2.distanceTransform(bordered, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) > radius
    if not core.any():
        return np.zeros_like(mask)
    outside = cv2.distanceTransform((~core).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return (outside < radius)[1:-1, 1:-1].astype(np.uint8) & mask


def _largest(mask: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W"] | None:
    count, parts, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if count < 2:
        return None
    return (parts == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())).astype(np.uint8)


def _fill_small_holes(mask: UInt8[np.ndarray, "H W"], area: float) -> None:
    contours, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    for i, contour in enumerate(contours):
        if tree[0, i, 3] >= 0 and cv2.contourArea(contour) <= area:
            cv2.drawContours(mask, contours, i, 1, cv2.FILLED)
