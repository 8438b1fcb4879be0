"""Demonstrations from videos: the boxes that come with them, or those that a detector finds.

    demos = import_videos("videos", robot=["hand"])      # in memory
    demos.save("mine")                                  # or import_videos("videos", "mine", ...)

A folder holds videos, MAGICAL's `*.pkl.gz` files, or a LeRobot dataset.
"""

import math
import os
import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from gril_jax.errors import DemoError
from gril_jax.threads import parallel_map

from . import boxed, detected
from .demo_set import DemoSet, load_demo_set, save_demo_set
from .detection.kept import Kept, chosen
from .detection.wanted import Wanted, wanted
from .folders import videos_in, visible
from .formats import boxes_of, lerobot
from .formats.record import Box, Film
from .magical_pickles import FPS
from .own_detector import Detect, detecting
from .schema import NO_TASK
from .vision.detect import Detector
from .vision.timed import look

_BOXED = ("robot", "classes", "fps", "jitter", "smoothing", "camera")  # not of detected boxes


def import_videos(
    folder: str | os.PathLike,
    out: str | os.PathLike | None = None,
    *,
    boxes: str | Detect | Detector = "auto",
    detect: str | None = None,
    detect_model: str | None = None,
    detect_score: float | None = None,
    names: str | os.PathLike | None = None,
    robot: str | Sequence[str] = (),
    half_extent: float | None = None,
    classes: Sequence[str] | None = None,
    task: str | None = None,
    fps: float | None = None,
    jitter: float | None = None,
    smoothing: int | None = None,
    outcome: str | Mapping[str, str] = "unknown",
    camera: str | None = None,
    source: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    writing: Callable[[int, int], None] | None = None,
    detecting: Callable[[int, int], None] | None = None,
) -> DemoSet:
    """Demonstrations of a folder, sorted by name.

    Args:
      folder: of videos, of MAGICAL's `*.pkl.gz` files, or of a LeRobot dataset.
      out: a folder for the set, which replaces an older set there; None writes nothing.
      boxes: "auto" reads the boxes beside each video, in any known format. "colour" finds the
        objects of MAGICAL's palette. A function, or its name `FILE.py:FUNCTION`, is a detector:
        `Detect`. A `Detector` gives `Tracks` itself.
      detect: classes to find in the videos, with commas between them, such as "2 cups, hand": of
        each one object a frame, or as many as the number says. Or an ONNX file of YOLOX, RF-DETR
        or YOLO. Boxes are kept in the folder `detected` beside the videos.
      detect_model: what finds them: a model of Hugging Face or its folder, or an ONNX file; None
        takes OWLv2.
      detect_score: of a box, at least; None takes 0.1 for OWL-ViT and OWLv2, and 0.3 for others.
      names: a text with the names of an ONNX file's classes, one a line.
      robot: classes that are parts of a robot, or of a person; what they do is no progress.
      half_extent: half the width of what a frame shows, in a unit of one's own; None measures in
        widths of the picture.
      classes: those of a task, which the boxes must be of; None takes those of the boxes.
      task: its name, if the videos are of one.
      fps: frames a second of the set; None takes those of the slowest video, at most 10.
      jitter: standard deviation of a box's centre, pixels; None estimates it.
      smoothing: frames of the video that boxes are smoothed over, odd; None takes those of 0.3 s
        where boxes jitter.
      outcome: "success", "failure" or "unknown": of all the videos, or of each by its name.
      camera: of a LeRobot dataset that has several.
      source: where the videos came from, in words; None names the folder.
      progress: called with the numbers of videos read and of all videos.
      writing: the same, with the videos that are written to the set.
      detecting: called with the numbers of frames in which boxes were sought, and of all frames.

    Raises:
      DemoError: no videos, a damaged one, or boxes that are missing, malformed or do not fit.

    Example:
      >>> demos = import_videos("videos", boxes="auto", robot=["hand"])  # doctest: +SKIP
    """
    _require(half_extent=half_extent, fps=fps, jitter=jitter, smoothing=smoothing)
    _require_one_source(boxes, detect, detect_model=detect_model, names=names,
                        detect_score=detect_score)  # fmt: skip
    folder, robot = pathlib.Path(folder), [robot] if isinstance(robot, str) else robot
    steps = _Counted(progress)
    options = {"half_extent": half_extent, "outcome": outcome, "source": source}
    given = (robot, classes, fps, jitter, smoothing, camera)
    wrong = [name for name, value in zip(_BOXED, given, strict=True) if value]
    if visible(folder, "*.pkl.gz"):
        known = {
            "detect": detect is not None, "half_extent": half_extent is not None,
            "boxes": boxes not in ("auto", "colour"), "outcome": outcome != "unknown",
        }  # fmt: skip
        wrong = [name for name in wrong if name != "fps"]
        _require_recorded(folder, fps, wrong + [name for name, given in known.items() if given])
        found = detected.of_magical(folder, task, steps, source)
    elif boxes == "colour" or isinstance(boxes, Detector):
        if wrong:
            raise DemoError(f"{wrong[0]} is of boxes beside the videos, not of boxes by colour.")
        detector = None if boxes == "colour" else boxes
        found = detected.of_videos(
            folder, videos_in(folder, out), detector, task=task, progress=steps, **options
        )
    else:
        asked = None
        if detect is not None:  # first, since most that can be wrong is wrong here
            asked = wanted(detect, model=detect_model, names=names, score=detect_score,
                           robot=robot, classes=classes)  # fmt: skip
        films, own = _films(folder, out, camera)
        note, read = "", _reader(boxes) or own
        if asked is not None:
            note, read = _detected(folder, films, asked, detecting)
        found = boxed.of_films(
            folder, films, read, robots=robot, classes=classes, fps=fps,
            task=NO_TASK if task is None else task, jitter=jitter, smoothing=smoothing,
            progress=steps, **options,
        )  # fmt: skip
        found = replace(found, notes=note + found.notes)
    if out is None:
        return found
    save_demo_set(found, out, progress=_Counted(writing))
    return replace(load_demo_set(out), notes=found.notes)


_BOUNDS = {  # of an option that is given
    "half_extent": (lambda x: 0 < x < math.inf, "above 0"),
    "fps": (lambda x: 0.1 <= x <= 1000, "from 0.1 to 1000"),
    "jitter": (lambda x: 0 <= x <= 1000, "from 0 to 1000"),
    "smoothing": (lambda x: 1 <= x < 1000 and x % 2 == 1, "odd and from 1 to 999"),
}


def _require(**given: int | float | None) -> None:
    """Raises DemoError for a number that is out of its bounds."""
    for name, value in given.items():
        holds, words = _BOUNDS[name]
        if value is not None and not holds(value):
            raise DemoError(f"{name} is {value}, but must be {words}.")


def _require_one_source(boxes: object, detect: str | None, **more: object) -> None:
    """Raises DemoError for two sources of boxes, or options of a detector where there is none."""
    if detect is not None and boxes != "auto":
        raise DemoError("boxes and detect are two sources of boxes; give one of them.")
    for name, value in more.items():
        if value is not None and detect is None:
            raise DemoError(f"{name} is given, but not detect, which says what to find.")


def _require_recorded(folder: pathlib.Path, fps: float | None, others: Sequence[str]) -> None:
    """Raises DemoError if options contradict MAGICAL's recordings, whose objects are found by
    colour."""
    if fps is not None and fps != FPS:
        raise DemoError(
            f"fps is {fps:g}, but the *.pkl.gz recordings in {folder} have {FPS:g} frames a "
            "second, which is the set's rate."
        )
    if others:
        raise DemoError(
            f"{others[0]} is given, but {folder} holds *.pkl.gz recordings: their objects are "
            "found by colour, and they know their size, frame rate and outcome."
        )


class _Counted:
    """Counts videos for a callback that is called with those done and all."""

    def __init__(self, tell: Callable[[int, int], None] | None):
        self.tell, self.done = tell, 0

    def __call__(self, videos: int) -> None:
        self.done += 1
        if self.tell is not None:
            self.tell(self.done, videos)


def _films(
    folder: pathlib.Path, out: str | os.PathLike | None, camera: str | None
) -> tuple[list[Film], Callable[[Film], list[Box]]]:
    """The videos of a folder, and what reads the boxes that come with them."""
    if lerobot.is_dataset(folder):
        dataset = lerobot.opened(folder)
        films = lerobot.films(dataset, lerobot.camera_of(dataset, camera))
        return films, lerobot.boxes_in(dataset)
    if camera is not None:
        raise DemoError(f"camera is {camera!r}, but {folder} is no LeRobot dataset.")
    return list(parallel_map(look, videos_in(folder, out))), boxes_of


def _detected(
    folder: pathlib.Path,
    films: Sequence[Film],
    asked: Wanted,
    detecting: Callable[[int, int], None] | None,
) -> tuple[str, Callable[[Film], list[Box]]]:
    """A sentence on the boxes that a detector finds, and what gives those of a video."""
    kept = Kept(folder, asked)
    found = kept(films, detecting or (lambda done, total: None))
    counted, rare = chosen(found, films, asked)
    kept.write_counted(counted)
    words = f"{asked.words}; left out as rare: {', '.join(rare)}" if rare else asked.words
    return f"{words}\n", lambda film: counted[film.name]


def _reader(boxes: str | Detect) -> Callable[[Film], list[Box]] | None:
    """What gives the boxes of a video; None for those that come with it."""
    if boxes == "auto":
        return None
    if callable(boxes) or ":" in str(boxes):
        return detecting(boxes)
    raise DemoError(
        f"boxes is {boxes!r}, but must be auto, colour, or a detector FILE.py:FUNCTION."
    )
