"""Input and output layouts of exported detectors: outputs to boxes and scores.

The kind is told from the outputs' shapes. Shapes use S for the pixels of the input (height and
width), N for candidates and C for classes; edges are x_min, y_min, x_max, y_max in input pixels.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Boxes = Float[np.ndarray, "N 4"]
Scores = Float[np.ndarray, "N C"]
Outputs = Sequence[np.ndarray]  # each without its batch
Decode = Callable[[Outputs, tuple[int, int]], tuple[Boxes, Scores]]
"""(outputs, input height and width) -> boxes in input pixels, and a score for each class."""

_STRIDES = (8, 16, 32, 64)  # pixels of a cell; 64 is of the largest networks alone
_ANCHORS = 3  # boxes of a cell in YOLOv5 and YOLOv7
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of ImageNet, RGB
_COCO_GAPS = (12, 26, 29, 30, 45, 66, 68, 69, 71, 83)  # numbers up to 90 that no class of COCO has
_COCO_NAMES, _COCO_ALL = 80, 91  # classes, and the numbers with the gaps and 0


class Layout(NamedTuple):
    """One kind of detector."""

    name: str
    decode: Decode
    classes: int  # scores of each candidate
    place: str = "middle"  # of the picture in the input: "middle", "corner", or "stretched" over it
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    deviation: tuple[float, float, float] = (1.0, 1.0, 1.0)  # both of values from 0 to 1
    rgb: bool = True


KNOWN = (
    "YOLOX 1 x N x (5 + classes), YOLOv5 and v7 1 x 3N x (5 + classes), YOLOv8 and v11 1 x (4 + "
    "classes) x N, YOLO end-to-end 1 x N x 6, RF-DETR 1 x N x 4 and 1 x N x classes"
)


def layout_of(shapes: Sequence[tuple[int, ...]], size: tuple[int, int]) -> Layout | None:
    """The kind of detector that has outputs of these shapes, without the batch, for an input of a
    height and width; None if it is not known.

    >>> layout_of([(84, 8400)], (640, 640)).name, layout_of([(8400, 85)], (640, 640)).name
    ('YOLOv8', 'YOLOX')
    >>> layout_of([(25200, 85)], (640, 640)).name, layout_of([(300, 6)], (640, 640)).name
    ('YOLOv5', 'YOLO end-to-end')
    >>> layout_of([(300, 4), (300, 91)], (560, 560)).name
    'RF-DETR'
    >>> layout_of([(7, 7)], (640, 640))
    """
    if len(shapes) == 2 and all(len(shape) == 2 for shape in shapes):
        (boxes, four), (scores, classes) = sorted(shapes, key=lambda shape: shape[1] != 4)
        if four == 4 and boxes == scores:
            return Layout("RF-DETR", _rf_detr, classes, "stretched", _MEAN, _DEVIATION)
    if len(shapes) != 1 or len(shapes[0]) != 2:
        return None
    rows, columns = shapes[0]
    cells = {_cells(size, levels) for levels in (3, 4)}
    if rows in cells and columns > 5:
        return Layout("YOLOX", _yolox, columns - 5, "corner", deviation=(1 / 255,) * 3, rgb=False)
    if rows in {_ANCHORS * number for number in cells} and columns > 5:
        return Layout("YOLOv5", _yolo_5, columns - 5)
    if columns == 6:
        return Layout("YOLO end-to-end", _end_to_end, 0)
    if columns in cells and rows > 4:
        return Layout("YOLOv8", _yolo_8, rows - 4)
    return None


def places_of(names: int, classes: int, layout: Layout) -> list[int] | None:
    """The score of each name, for a number of names; None if they cannot be told.

    DETR's kind has one score more than classes. That of COCO numbers its 80 classes up to 90, as
    COCO does; otherwise the last score is that of nothing.

    >>> rf_detr = Layout("RF-DETR", _rf_detr, 91)
    >>> places_of(80, 91, rf_detr)[:13]
    [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 14]
    >>> places_of(4, 5, rf_detr), places_of(5, 5, rf_detr), places_of(3, 5, rf_detr)
    ([0, 1, 2, 3], [0, 1, 2, 3, 4], None)
    """
    if names == classes or classes == 0:
        return [*range(names)]
    if layout.decode is not _rf_detr:
        return None
    if (names, classes) == (_COCO_NAMES, _COCO_ALL):
        return [number for number in range(1, _COCO_ALL) if number not in _COCO_GAPS]
    if (names, classes) == (_COCO_ALL - 1, _COCO_ALL):
        return [*range(1, _COCO_ALL)]
    return [*range(names)] if names == classes - 1 else None


def _cells(size: tuple[int, int], levels: int) -> int:
    return sum((size[0] // stride) * (size[1] // stride) for stride in _STRIDES[:levels])


def _corners(middles: Float[np.ndarray, "N 4"]) -> Boxes:
    """Edges of boxes that are given by their middle and sides."""
    center, half = middles[:, :2], middles[:, 2:] / 2
    return np.concatenate([center - half, center + half], axis=1)


def _yolo_8(outputs: Outputs, size: tuple[int, int]) -> tuple[Boxes, Scores]:
    found = outputs[0].T
    return _corners(found[:, :4]), found[:, 4:]


def _yolo_5(outputs: Outputs, size: tuple[int, int]) -> tuple[Boxes, Scores]:
    found = outputs[0]
    return _corners(found[:, :4]), found[:, 4:5] * found[:, 5:]


def _yolox(outputs: Outputs, size: tuple[int, int]) -> tuple[Boxes, Scores]:
    """Boxes in cells, as the exporter of YOLOX gives them unless it is told to decode."""
    found = outputs[0]
    boxes = found[:, :4]
    # The middles of decoded boxes are all over the input; others are near 0, beside their cells.
    if np.median(np.abs(boxes[:, :2])) < _STRIDES[0]:
        cell, stride = _grid(size, len(found))
        boxes = np.concatenate([(boxes[:, :2] + cell) * stride, np.exp(boxes[:, 2:]) * stride], 1)
    return _corners(boxes), found[:, 4:5] * found[:, 5:]


def _grid(
    size: tuple[int, int], total: int
) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "N 1"]]:
    """The column and row of each cell, and the pixels of its side, from small to large cells."""
    cells, strides = [], []
    for stride in _STRIDES[: 3 if total == _cells(size, 3) else 4]:
        rows, columns = size[0] // stride, size[1] // stride
        at = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        cells.append(at.astype(float)), strides.append(np.full((len(at), 1), float(stride)))
    return np.concatenate(cells), np.concatenate(strides)


def _end_to_end(outputs: Outputs, size: tuple[int, int]) -> tuple[Boxes, Scores]:
    """Edges, a score and the number of a class."""
    found = outputs[0]
    number = np.round(found[:, 5]).astype(int)
    scores = np.zeros((len(found), max(number.max(initial=0), 0) + 1))
    known = number >= 0
    scores[np.flatnonzero(known), number[known]] = found[known, 4]
    return found[:, :4], scores


def _rf_detr(outputs: Outputs, size: tuple[int, int]) -> tuple[Boxes, Scores]:
    """Boxes in shares of the input, and logits."""
    boxes, logits = sorted(outputs, key=lambda found: found.shape[1] != 4)
    edges = _corners(boxes) * np.array([size[1], size[0], size[1], size[0]])
    return edges, 1 / (1 + np.exp(-logits))
