"""Synthetic MatchRegions scenes in the reference palette, drawn with OpenCV for the tests.

Outlines are written down here once more, from the task's specification, so that a wrong number
in the detector does not cancel out.
"""

import math
import os
import pathlib

import cv2
import numpy as np

from .paths import SHARED_DATA

HALF_EXTENT = 1.122
GOAL = ((0.40, 0.35), (0.6, 0.7))  # centre, size
BLOCKS = {
    "green star": (0.80, -0.70, 2.37),
    "green square": (-0.68, 0.72, 1.28),
    "blue pentagon": (-0.05, -0.20, -1.09),
    "yellow pentagon": (0.30, -0.82, -1.15),
    "yellow circle": (-0.75, -0.55, 2.78),
}
ROBOT = (-0.5, 0.1, 2.513)
COLOURS = {
    "green": ((195, 208, 130), (183, 198, 105), (224, 231, 191)),
    "blue": ((135, 185, 211), (110, 170, 202), (195, 220, 233)),
    "yellow": ((254, 213, 123), (254, 201, 86), (254, 234, 189)),
    "red": ((245, 129, 165), (243, 94, 141), (250, 192, 210)),
}
_GREY, _GREY_DARK, _PALE = (162, 163, 175), (144, 145, 159), (231, 231, 234)
_SHIFT = 6  # sub-pixel bits of OpenCV's polygons


def shared_data():
    """The folder of shared test data, which may be missing."""
    return pathlib.Path(os.environ.get("GRIL_SHARED_DATA", SHARED_DATA))


def corners(shape):
    """Corners around the centre of mass, body frame, world units."""
    if shape == "circle":
        turn = np.linspace(0, 2 * math.pi, 60, endpoint=False)
        return 0.12 * np.stack([np.cos(turn), np.sin(turn)], -1)
    if shape == "square":
        return 0.2127 / 2 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    count, radii = (10, (0.156, 0.078)) if shape == "star" else (5, (0.1379, 0.1379))
    turn = math.pi / 2 + 2 * math.pi * np.arange(count) / count
    radius = np.where(np.arange(count) % 2, radii[1], radii[0])
    return radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], -1)


def placed(points, x, y, angle):
    cos, sin = math.cos(angle), math.sin(angle)
    return points @ np.array([[cos, sin], [-sin, cos]]) + [x, y]


def box_of(name, pose):
    """Width and height of a block's axis-aligned box, world units."""
    return np.ptp(placed(corners(name.split()[1]), *pose), axis=0)


def scene(
    blocks=None,
    robot=ROBOT,
    *,
    stick=None,
    goal_colour="green",
    goal=GOAL,
    half_extent=HALF_EXTENT,
    side=384,
    smooth=False,
    outlines=True,
):
    """One (side, side, 3) frame; `smooth` blends edges as OpenGL does."""
    zoom = 4 if smooth else 1
    canvas = _Canvas(side * zoom, half_extent, zoom * side / 384)
    canvas.box(-half_extent * 0.98, -half_extent * 0.98, *[2 * 0.98 * half_extent] * 2, (255,) * 3)
    canvas.frame(half_extent * 0.98, _GREY, 2)
    if goal is not None:
        canvas.goal(goal, goal_colour)
    for name, pose in (BLOCKS if blocks is None else dict(blocks)).items():
        colour, shape = name.split("#")[0].split()
        fill, outline, _ = COLOURS[colour]
        canvas.polygon(placed(corners(shape), *pose), fill, outline if outlines else None)
    if robot is not None:
        canvas.stick(robot, stick) if stick else canvas.gripper(robot)
    image = canvas.image
    return cv2.resize(image, (side, side), interpolation=cv2.INTER_AREA) if smooth else image


class _Canvas:
    def __init__(self, side, half_extent, stroke):
        self.scale, self.half, self.stroke = side / (2 * half_extent), half_extent, stroke
        self.image = np.full((side, side, 3), _PALE, np.uint8)

    def pixels(self, points):
        points = np.asarray(points, float)
        at = np.stack([points[:, 0] + self.half, self.half - points[:, 1]], -1) * self.scale - 0.5
        return np.round(at * (1 << _SHIFT)).astype(np.int32)

    def polygon(self, points, fill, outline=None):
        cv2.fillPoly(self.image, [self.pixels(points)], fill, shift=_SHIFT)
        if outline is not None:
            inner = points.mean(0) + (points - points.mean(0)) * 0.86
            cv2.fillPoly(self.image, [self.pixels(points)], outline, shift=_SHIFT)
            cv2.fillPoly(self.image, [self.pixels(inner)], fill, shift=_SHIFT)

    def box(self, x, y, width, height, fill):
        low = np.floor((np.array([x + self.half, self.half - y - height])) * self.scale + 0.5)
        size = np.round(np.array([width, height]) * self.scale)
        (left, top), (right, bottom) = low.astype(int), (low + size).astype(int)
        self.image[max(top, 0) : bottom, max(left, 0) : right] = fill

    def frame(self, half, colour, width):
        at = self.pixels([[-half, -half], [half, half]])
        cv2.rectangle(self.image, at[0], at[1], colour, int(width * self.stroke), shift=_SHIFT)

    def goal(self, goal, colour):
        (x, y), (width, height) = goal
        left, bottom = x - width / 2, y - height / 2
        self.box(left, bottom, width, height, COLOURS[colour][2])
        dash, thick = 10 * self.stroke / self.scale, 4 * self.stroke / self.scale
        for start in np.arange(0, width, 2 * dash):
            for edge in (bottom, bottom + height):
                run = min(dash, width - start)
                self.box(left + start, edge - thick / 2, run, thick, COLOURS[colour][0])
        for start in np.arange(0, height, 2 * dash):
            for edge in (left, left + width):
                run = min(dash, height - start)
                self.box(edge - thick / 2, bottom + start, thick, run, COLOURS[colour][0])

    def disc(self, points, fill):
        for x, y, radius in points:
            turn = np.linspace(0, 2 * math.pi, 90, endpoint=False)
            self.polygon([x, y] + radius * np.stack([np.cos(turn), np.sin(turn)], -1), fill)

    def gripper(self, pose):
        for side in (1, -1):
            bend = np.array([[0.13, 0.1], [0.13, 0.32], [0.075, 0.45]])
            arm = bend * [side, 1.0]
            arm = placed(arm, *pose)
            for colour, width in ((_GREY, 0.05), (_PALE, 0.03)):
                cv2.polylines(
                    self.image,
                    [self.pixels(arm)],
                    False,
                    colour,
                    max(1, int(width * self.scale)),
                    shift=_SHIFT,
                )
        self.disc([(*pose[:2], 0.2)], _GREY_DARK)
        self.disc([(*pose[:2], 0.188)], _GREY)
        eyes = placed(np.array([[0.08, 0.06], [-0.08, 0.06]]), *pose)
        self.disc([(*eye, 0.04) for eye in eyes], (255, 255, 255))
        self.disc([(*eye, 0.024) for eye in eyes], (26, 26, 26))

    def stick(self, pose, width):
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [width / 2, 0.05]
        self.polygon(placed(half, *pose), _GREY, _GREY_DARK)
