"""Object boxes from a CSV file, in place of colour detection.

Any detector can write the file; its first line names the columns, in any order, and further ones
are ignored:

    frame,class,x_min,y_min,x_max,y_max
    0,robot,29.0,136.5,136.0,249.0
    0,green star,317,295,371,349

One row is one object in one frame. Frames count from 0. Box edges are in pixels of the video,
as continuous coordinates with (0, 0) in the top left corner of the frame and y down. An object
may miss in some frames (its last box is carried on), and no class may come twice in a frame.
A file that is missing, malformed, or does not fit its video is a `DemoError`.
"""

import csv
import errno
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from gril_jax.demos.vision.detect import Tracks, carried
from gril_jax.errors import DemoError

COLUMNS = ("frame", "class", "x_min", "y_min", "x_max", "y_max")

_LARGEST = 1e30  # pixels; beyond it, float32 would overflow

_Boxes = dict[tuple[int, str], tuple[float, float, float, float]]


@dataclass(frozen=True)
class BoxesFileDetector:
    """A `Detector` of `gril_jax.demos.vision.detect` for a boxes file; centres are middles."""

    path: str | os.PathLike  # the CSV file that belongs to the video
    classes: Sequence[str]  # the task's class names; a label is an index into them
    half_extent: float  # world units: half the width of the world that a frame shows

    def detect(self, frames: UInt8[np.ndarray, "T H W 3"], *, name: str = "video") -> Tracks:
        """The file's boxes in world units, objects in the order of the class names."""
        boxes = self._read(len(frames))
        names = sorted({class_name for _, class_name in boxes}, key=self.classes.index)
        if not names:
            raise DemoError(f"{self.path}: the boxes file of {name} has no rows below its header.")
        if "goal" in self.classes and "goal" not in names:
            raise DemoError(
                f"{self.path}: the boxes file of {name} has no row of class 'goal'; "
                "at least one frame must hold the goal region."
            )
        corners = np.full((len(frames), len(names), 4), np.nan)
        for (frame, class_name), box in boxes.items():
            corners[frame, names.index(class_name)] = box
        seen = ~np.isnan(corners[..., 0])
        corners = carried(corners, seen)
        height, width = frames.shape[1:3]
        scale = width / (2 * self.half_extent)
        low, high = corners[..., :2], corners[..., 2:]
        center = ((low + high) / 2 - [width / 2, height / 2]) / scale * [1.0, -1.0]
        label = np.array([self.classes.index(n) for n in names], np.int32)
        size = (high - low) / scale
        return Tracks(center.astype(np.float32), size.astype(np.float32), label, seen)

    def _read(self, num_frames: int) -> _Boxes:
        if not os.path.isfile(self.path):  # a pipe or a device would never end
            fault = "no regular file" if os.path.exists(self.path) else os.strerror(errno.ENOENT)
            raise DemoError(f"{self.path}: the boxes file cannot be read ({fault}).")
        try:
            with open(self.path, newline="", encoding="utf-8-sig") as file:
                return self._parse(csv.reader(file), num_frames)
        except OSError as error:
            raise DemoError(
                f"{self.path}: the boxes file cannot be read ({error.strerror})."
            ) from error
        except (UnicodeDecodeError, csv.Error) as error:
            raise DemoError(f"{self.path}: the boxes file is not CSV text in UTF-8.") from error

    def _parse(self, rows, num_frames: int) -> _Boxes:
        header = [cell.strip() for cell in next(rows, [])]
        columns = [cell for cell in header if cell in COLUMNS]
        if sorted(columns) != sorted(COLUMNS):
            raise DemoError(
                f"{self.path}, line 1: the columns must be {','.join(COLUMNS)}, "
                f"not {','.join(header)[:200] or 'an empty line'}."
            )
        boxes: _Boxes = {}
        for row in filter(None, rows):
            where = f"{self.path}, line {rows.line_num}"
            if len(row) != len(header):
                raise DemoError(
                    f"{where}: {len(row)} cells where {len(header)} are needed "
                    f"({','.join(header)[:200]})."
                )
            frame, class_name, box = self._row(dict(zip(header, row, strict=True)), where)
            if frame >= num_frames:
                raise DemoError(
                    f"{where}: frame {frame} is beyond the video, whose {num_frames} frames "
                    f"count from 0 to {num_frames - 1}."
                )
            if (frame, class_name) in boxes:
                raise DemoError(
                    f"{where}: a second {class_name!r} in frame {frame}; one is allowed."
                )
            boxes[frame, class_name] = box
        return boxes

    def _row(self, cells: dict[str, str], where: str):
        text = cells["frame"].strip()
        if not (text.isascii() and text.isdigit() and len(text) < 10):
            raise DemoError(f"{where}: frame must be a whole number from 0, not {text!r}.")
        class_name = cells["class"].strip()
        if class_name not in self.classes:
            raise DemoError(
                f"{where}: class {class_name!r:.60} is not one of {', '.join(self.classes)}."
            )
        box = []
        for column in COLUMNS[2:]:
            try:
                box.append(float(cells[column]))
            except ValueError:
                box.append(math.nan)
            if not abs(box[-1]) < _LARGEST:
                raise DemoError(f"{where}: {column} must be a number, not {cells[column]!r}.")
        if box[0] >= box[2] or box[1] >= box[3]:
            raise DemoError(
                f"{where}: a box needs x_min < x_max and y_min < y_max, "
                f"not {box[0]:g}, {box[2]:g} and {box[1]:g}, {box[3]:g}."
            )
        return int(text), class_name, tuple(box)
