"""A detector that is saved as ONNX, run by OpenCV: YOLOX, RF-DETR and YOLO, without PyTorch.

detect = onnx_detector(Path("yolox_s.onnx"), Path("coco.txt"))
detect(frames)            # for each frame its sightings
"""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from gril_jax.demos.formats.lines import names_in
from gril_jax.demos.formats.names import class_name
from gril_jax.demos.schema import digest
from gril_jax.errors import DemoError

from .layouts import KNOWN, Layout, layout_of, places_of
from .onnx_header import Header, read_header
from .sightings import Sighting, best_of

_USUAL = 640  # pixels of each side, where a model takes any
_GREY = 114  # around a picture, as these detectors have learned
_LONGEST = 150  # letters of what OpenCV says
_SILENT = 0  # level of its messages


class Fitted(NamedTuple):
    """A picture as the network takes it, and where the frame lies in it."""

    values: Float32[np.ndarray, "1 3 H W"]
    scale: tuple[float, float]  # pixels of the input for one of the frame, across and down
    shift: tuple[int, int]  # pixels of the input before the frame begins


@dataclass(frozen=True)
class OnnxDetector:
    """A network, its kind, and the names of its classes; a call finds boxes in frames."""

    path: Path
    net: cv2.dnn.Net
    layout: Layout
    size: tuple[int, int]  # height and width of the input
    names: list[str]
    places: list[int]  # of the names among the scores
    key: str  # tells it from others

    together = 1  # frames at once: exports have a batch of 1, as a rule

    def __call__(self, frames: UInt8[np.ndarray, "T H W 3"]) -> list[list[Sighting]]:
        """The sightings in each frame."""
        return [self._in_frame(frame) for frame in frames]

    def _in_frame(self, frame: UInt8[np.ndarray, "H W 3"]) -> list[Sighting]:
        fitted = fit(frame, self.size, self.layout)
        outputs = _run(self.path, self.net, fitted.values)
        edges, scores = self.layout.decode(outputs, self.size)
        edges = (edges - np.array(fitted.shift * 2)) / np.array(fitted.scale * 2)
        short = max(self.places) + 1 - scores.shape[1]  # of an end-to-end model, which lists few
        if self.layout.classes == 0 and scores.shape[1] > len(self.names):
            raise DemoError(
                f"{self.path}: found class {scores.shape[1] - 1}, but there are "
                f"{len(self.names)} names, which count from 0."
            )
        scores = np.pad(scores, ((0, 0), (0, max(short, 0))))[:, self.places]
        height, width = frame.shape[:2]
        return best_of(edges, scores, self.names, width, height)


def onnx_detector(path: Path, names: Path | None) -> OnnxDetector:
    """The detector of a file.

    `names` is a text with the name of a class in each line; None takes those that the file has.

    Raises:
      DemoError: no such file, no ONNX, a kind that is not known, or names of another number.
    """
    header = read_header(path)
    known = _named(path, header, names)
    size = tuple(side or _USUAL for side in header.input[2:])
    net = _loaded(path)
    grey = np.full((*size, 3), _GREY, np.uint8)
    outputs = _run(path, net, fit(grey, size, Layout("", None, 0)).values)
    shapes = [found.shape for found in outputs]
    layout = layout_of(shapes, size)
    if layout is None or not _plausible(layout, outputs):
        shown = " and ".join(" x ".join(map(str, (1, *shape))) for shape in shapes)
        raise DemoError(
            f"{path}: its outputs are {shown} for pictures of {size[1]} x {size[0]}, but must be "
            f"those of {KNOWN}."
        )
    places = places_of(len(known), layout.classes, layout)
    if places is None:
        where = path if names is None else names
        raise DemoError(
            f"{where}: has {len(known)} names, but {path.name} tells {layout.classes} classes "
            f"apart ({layout.name})."
        )
    key = f"{path.name}, {layout.name}, sha256 {digest(path)}, {', '.join(known)}"
    return OnnxDetector(path, net, layout, size, known, places, key)


def _plausible(layout: Layout, outputs: Sequence[np.ndarray]) -> bool:
    """False for outputs of a known shape whose values are others: RF-DETR's boxes are shares, and
    of YOLO end-to-end the sixth column is a class."""
    if layout.name == "RF-DETR":
        boxes = min(outputs, key=lambda found: found.shape[1] != 4)
        return bool(np.abs(boxes).max(initial=0) < 4)
    if layout.name == "YOLO end-to-end":
        return bool(np.allclose(outputs[0][:, 5], np.round(outputs[0][:, 5]), atol=1e-3))
    return True


def _named(path: Path, header: Header, names: Path | None) -> list[str]:
    if names is not None:
        return names_in(names)
    if header.names is None:
        raise DemoError(
            f"{path}: has no names of its classes; give a text with one in each line as names."
        )
    return [class_name(name, f"{path}, names") for name in header.names]


def _loaded(path: Path) -> cv2.dnn.Net:
    with _quiet():
        try:
            return cv2.dnn.readNetFromONNX(str(path))
        except cv2.error as error:
            raise DemoError(f"{path}: OpenCV cannot read it ({_said(error)}).") from None


def _run(path: Path, net: cv2.dnn.Net, values: Float32[np.ndarray, "1 3 H W"]) -> list[np.ndarray]:
    """The outputs, each without its batch of 1."""
    with _quiet():
        try:
            net.setInput(values)
            outputs = net.forward([*net.getUnconnectedOutLayersNames()])
        except cv2.error as error:
            raise DemoError(f"{path}: OpenCV cannot run it ({_said(error)}).") from None
    found = [np.asarray(one, float) for one in outputs]
    return [one[0] if one.ndim == 3 and len(one) == 1 else one for one in found]


def _said(error: cv2.error) -> str:
    """What OpenCV says, in a line."""
    return " ".join(str(error.err or error).split())[:_LONGEST]


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """OpenCV prints what it raises, too. Its level of messages is elsewhere before version 5."""
    log = getattr(cv2.utils, "logging", cv2)
    level = log.getLogLevel()
    log.setLogLevel(_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)


def fit(frame: UInt8[np.ndarray, "H W 3"], size: tuple[int, int], layout: Layout) -> Fitted:
    """A frame in the input of a network: whole, with grey around it unless it is stretched."""
    (height, width), (high, wide) = frame.shape[:2], size
    sides = wide, high
    if layout.place != "stretched":
        ratio = min(wide / width, high / height)
        sides = max(1, round(width * ratio)), max(1, round(height * ratio))
    shift = 0, 0
    if layout.place == "middle":
        shift = (wide - sides[0]) // 2, (high - sides[1]) // 2
    picture = np.full((high, wide, 3), _GREY, np.uint8)
    resized = cv2.resize(frame, sides, interpolation=cv2.INTER_LINEAR)
    picture[shift[1] : shift[1] + sides[1], shift[0] : shift[0] + sides[0]] = resized
    values = (picture.astype(np.float32) / 255 - np.float32(layout.mean)) / np.float32(
        layout.deviation
    )
    values = values if layout.rgb else values[..., ::-1]
    blob = np.ascontiguousarray(values.transpose(2, 0, 1)[None], np.float32)
    return Fitted(blob, (sides[0] / width, sides[1] / height), shift)
