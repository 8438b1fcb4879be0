"""What a user asks a detector for: classes, how many objects of each, and the least score."""

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from gril_jax.demos.formats.names import class_name
from gril_jax.errors import DemoError

from .onnx_detector import OnnxDetector, onnx_detector
from .sightings import MOST
from .text_detector import TextDetector, text_detector

_NUMBERED = re.compile(r"(\d+)\s*x?\s+(\S.*)")
_SCORES = {"owlvit": 0.1, "owlv2": 0.1}  # least ones; these models are sure of little
_SCORE = 0.3  # of all others


class Wanted(NamedTuple):
    """A detector, and which of its sightings count."""

    detector: OnnxDetector | TextDetector
    most: Mapping[str, int]  # objects of each class at once, at most
    score: float  # of a sighting, at least
    named: bool  # True if the user has named the classes, and so each must be found

    @property
    def words(self) -> str:
        """The detector and the score, for people."""
        name = self.detector.key.split(",")[0]
        return f"boxes by {name}, of a score of {self.score:g} or more"


def prompted(text: str) -> dict[str, int]:
    """The classes of a prompt, and how many objects of each a frame shows at most.

    >>> prompted("2 cups, coaster,hand")
    {'cups': 2, 'coaster': 1, 'hand': 1}
    """
    found: dict[str, int] = {}
    for part in (part for part in re.split(r"[,;\n]", text) if part.strip()):
        numbered = _NUMBERED.fullmatch(part.strip())
        number, word = (int(numbered[1]), numbered[2]) if numbered else (1, part)
        name = class_name(word, "detect")
        if name in found:
            raise DemoError(
                f"detect names {name!r} twice; '2 {name}' is how to look for two of them."
            )
        if not 1 <= number <= MOST:
            raise DemoError(f"detect asks for {number} {name}, but 1 to {MOST} can be told apart.")
        found[name] = number
    if not found:
        raise DemoError(
            "detect names nothing; it must be classes with commas between them, such as "
            "'cup, coaster, hand', or the file of a detector, such as yolox_s.onnx."
        )
    return found


def wanted(
    detect: str,
    *,
    model: str | None = None,
    names: str | Path | None = None,
    score: float | None = None,
    robot: Sequence[str] = (),
    classes: Sequence[str] | None = None,
) -> Wanted:
    """The detector, loaded, for a prompt or a file of ONNX.

    Args:
      detect: classes with commas between them, or a file that ends in .onnx, of which all count.
      model: a file that ends in .onnx, or a model of `text_detector`.
      names: of the classes of an ONNX file.
      score: the least that counts; None takes what is usual for the detector.
      robot: classes that must be among those.
      classes: of a task, which those must be of.
    """
    if score is not None and not 0 < score < 1:
        raise DemoError(f"detect_score is {score}, but must be above 0 and below 1.")
    alone = _is_onnx(detect)
    if alone and model is not None:
        raise DemoError(f"detect is {detect}, a detector, so that detect_model says it twice.")
    most = {} if alone else prompted(detect)
    file = detect if alone else model
    if most:
        _require([*most], robot, classes)
    if file is None or not _is_onnx(file):
        if names is not None:
            raise DemoError("names are of a detector in a file such as yolox_s.onnx, not of words.")
        found: OnnxDetector | TextDetector = text_detector([*most], file)
        usual = _SCORES.get(found.model.config.model_type, _SCORE)
        return Wanted(found, most, usual if score is None else score, True)
    found = onnx_detector(Path(file).expanduser(), None if names is None else Path(names))
    for name in most:
        if name not in found.names:
            near = ", ".join(difflib.get_close_matches(name, found.names)) or "none is like it"
            raise DemoError(f"{file}: has no class {name!r} among {len(found.names)} ({near}).")
    if alone:
        _require(found.names, robot, None)
        most = {name: MOST for name in found.names if classes is None or name in classes}
    return Wanted(found, most, _SCORE if score is None else score, not alone)


def _is_onnx(text: str) -> bool:
    return text.strip().lower().endswith(".onnx") and "," not in text


def _require(names: Sequence[str], robot: Sequence[str], classes: Sequence[str] | None) -> None:
    """Raises DemoError for a robot's class that is not looked for, or a class that is no task's."""
    shown = ", ".join([*names][:MOST]) + (", ..." if len(names) > MOST else "")
    for name in robot:
        if name not in names:
            raise DemoError(f"robot is {name!r}, which is not detected: the classes are {shown}.")
    for name in names:
        if classes is not None and name not in classes:
            raise DemoError(
                f"detect: class {name!r} is not one of the task's: {', '.join(classes)}."
            )
