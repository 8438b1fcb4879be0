"""The MAGICAL and x-magical palette: classifies a frame's pixels by colour.

Both simulators draw flat colours, one fill and one slightly darker outline a colour. A pixel takes
the nearest of them within a tolerance, so that frames from a video codec are read like exact ones.
"""

import functools

import numpy as np
from jaxtyping import UInt8

BLOCK_COLOURS = ("green", "blue", "yellow", "red")
BLOCK_SHAPES = ("star", "square", "pentagon", "circle")
PALETTE_CLASSES = (
    "goal",
    "robot",
    *(f"{colour} {shape}" for colour in BLOCK_COLOURS for shape in BLOCK_SHAPES),
)
"""Class names in label order; a label is an index into this tuple."""

SUITE_CLASSES = (
    "robot",
    *(f"{colour} region" for colour in BLOCK_COLOURS),
    *(f"{colour} {shape}" for colour in BLOCK_COLOURS for shape in BLOCK_SHAPES),
)
"""Class names of MAGICAL's tasks with its own draws, whose regions differ in colour."""
SUITE = (
    "move_to_corner", "move_to_region", "find_dupe", "fix_colour", "cluster_colour",
    "cluster_shape", "make_line", "match_regions_magical",
)  # fmt: skip
"""These tasks."""

RGB = {  # (fill, outline)
    "green": ((195, 208, 130), (183, 198, 105)),
    "blue": ((135, 185, 211), (110, 170, 202)),
    "yellow": ((254, 213, 123), (254, 201, 86)),
    "red": ((245, 129, 165), (243, 94, 141)),
    "grey": ((162, 163, 175), (144, 145, 159)),
}
_BACKGROUND = ((255, 255, 255), (231, 231, 234), (26, 26, 26))  # floor, outside, pupils

GREY = 1
_TOLERANCE = 45.0  # RGB distance; a codec moves fills by under 10, mixed edges by far more
_BITS = 6  # per channel in the look-up table


def block_code(colour: str) -> int:
    """The code of a block colour in `classify`, for fill and outline alike."""
    return 2 + BLOCK_COLOURS.index(colour)


def goal_code(colour: str) -> int:
    """The code in `classify` of the pale fill of a goal region of that colour."""
    return 6 + BLOCK_COLOURS.index(colour)


def fills(frame: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W"]:
    """The palette code of every pixel, but 0 for outlines, which keep blocks that touch apart."""
    return _looked_up(frame, _table(outlines=False))


def classify(frame: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W"]:
    """The palette code of every pixel; 0 for background and for colours outside the palette."""
    return _looked_up(frame, _table(outlines=True))


def _looked_up(frame: np.ndarray, table: UInt8[np.ndarray, "C"]) -> UInt8[np.ndarray, "H W"]:
    coarse = (frame >> (8 - _BITS)).astype(np.int32)
    index = (coarse[..., 0] << 2 * _BITS) | (coarse[..., 1] << _BITS) | coarse[..., 2]
    return table[index]


@functools.cache
def _table(*, outlines: bool) -> UInt8[np.ndarray, "C"]:
    anchors = [(0, rgb) for rgb in _BACKGROUND]
    anchors += [(GREY, rgb) for rgb in RGB["grey"]]
    for colour in BLOCK_COLOURS:
        fill, outline = RGB[colour]
        pale = tuple((255 + value) // 2 for value in fill)  # goals are drawn half as saturated
        anchors += [(block_code(colour), fill), (block_code(colour) if outlines else 0, outline)]
        anchors += [(goal_code(colour), pale)]
    codes = np.array([code for code, _ in anchors], np.uint8)
    step = 1 << (8 - _BITS)
    levels = np.arange(0, 256, step, dtype=np.float32) + (step - 1) / 2
    cube = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1).reshape(-1, 3)
    distance = np.stack([((cube - np.float32(rgb)) ** 2).sum(-1) for _, rgb in anchors])
    near = distance.min(0) < np.float32(_TOLERANCE**2)
    return np.where(near, codes[distance.argmin(0)], np.uint8(0))
