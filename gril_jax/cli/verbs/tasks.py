"""Verbs for demonstration sets, and for a task of one's own: a skeleton, and what it lacks."""

import keyword
from dataclasses import dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gril_jax.config import DemosConfig, EnvConfig, MakeDemosConfig
from gril_jax.config.run_config import Section
from gril_jax.config.tables import above, between, optional, rule
from gril_jax.config.task import PLACES
from gril_jax.envs import registry
from gril_jax.errors import ConfigError
from gril_jax.safe_files import new_file, writing

from ..arguments import (
    Work,
    demo_set_to_write,
    echo,
    existing_folder,
    named_detector,
    named_task,
    require_new_file,
    require_task,
)
from ..configured import ConfigName, read
from ..heavy_imports import heavy_imports
from . import Verb, experiment, simple

_MAKE = "gril demos make"


@dataclass(frozen=True)
class _OwnMake:
    config: ConfigName = None
    out: str | None = None
    """New folder of the demonstration set, which must be named."""
    variant: str | None = None
    """Variant of the starts: demo, jitter, layout, or one of a task of yours. None: jitter if the
    configuration's is that, else layout."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of the starts and of the expert."""


@dataclass(frozen=True)
class _Make(_OwnMake):
    env: Section[EnvConfig] = field(default=EnvConfig())
    demos: tyro.conf.OmitArgPrefixes[Section[DemosConfig]] = field(default=DemosConfig())


def _make(args: list[str]) -> Work:
    about = "Make scripted demonstrations of a configuration's task."
    given = read(_Make(), args, _MAKE, about)
    if given.out is None:
        raise ConfigError(f"{_MAKE} needs --out: see {_MAKE} --help")
    config = MakeDemosConfig(given.env, given.demos)
    require_task(config.env)
    config.env.require_variant("--variant", given.variant, PLACES)
    if given.variant is not None:
        config.env.require_places("--variant", given.variant)
    folder, starts = demo_set_to_write(given.out), {"variant": given.variant, "seed": given.seed}
    return experiment("build.make_demos", config, folder, config=config, devices=True, **starts)


@dataclass(frozen=True)
class _Import:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of videos, of MAGICAL's *.pkl.gz files, or of a LeRobot dataset."""
    out: str
    """Folder of the demonstration set."""
    boxes: str = "auto"
    """auto reads the boxes beside each video, in any of the formats that are known; colour finds
    the objects of MAGICAL's palette; FILE.py:FUNCTION is a detector of yours, from frames to
    boxes."""
    detect: str | None = None
    """Objects to find in videos without boxes: classes with commas between them, such as "2 cups,
    hand", or an ONNX file of YOLOX, RF-DETR or YOLO."""
    detect_model: str | None = None
    """Detector of these objects: a model of Hugging Face or its folder, or an ONNX file; None is
    OWLv2."""
    detect_score: float | None = field(default=None, metadata=optional(between(0.01, 0.99)))
    """Score of a box, at least; None is 0.1 for OWL-ViT and OWLv2, 0.3 for others."""
    names: str | None = None
    """Text with the names of an ONNX file's classes, one a line; None takes those in the file."""
    half_extent: float | None = field(default=None, metadata=optional(above(0)))
    """Half the width of the world that a frame shows, in a unit of yours; None measures in widths
    of the picture."""
    task: str | None = None
    """The task whose classes the boxes have; None takes the boxes' own."""
    robot: tuple[str, ...] = ()
    """Classes of the robot, or of the hand; their own motion is no progress."""
    camera: str | None = None
    """The camera of a LeRobot dataset, if it has several."""
    fps: float | None = field(default=None, metadata=optional(between(0.1, 1000)))
    """Frames per second of the set; None is the slowest video's, at most 10."""
    jitter: float | None = field(default=None, metadata=optional(between(0, 1000)))
    """Standard deviation of a box's place, pixels of the video; None estimates it."""
    smoothing: int | None = field(
        default=None, metadata=optional(rule(lambda x: 1 <= x < 1000 and x % 2 == 1, "odd"))
    )
    """Frames of the video that boxes are smoothed over; None is 0.3 s if they jitter."""
    outcome: Literal["success", "failure", "unknown"] = "unknown"
    """Outcome of all the videos."""


def _videos(given: _Import) -> Work:
    if given.task is not None:
        EnvConfig(name=given.task).check()
    if given.boxes == "colour" and given.half_extent is None:
        raise ConfigError("gril demos import-videos needs --half-extent where --boxes is colour")
    options = {one.name: getattr(given, one.name) for one in fields(_Import)}
    options["boxes"] = named_detector(given.boxes)
    folders = existing_folder(options.pop("source")), demo_set_to_write(options.pop("out"))
    return experiment("import_videos", *folders, **options)


@dataclass(frozen=True)
class _Check:
    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE:make")]
    """The task: FILE.py:FUNCTION, or an entry point of `gril_jax.tasks`."""
    options: tuple[str, ...] = field(default=())
    """Keyword arguments of its function, each NAME=VALUE."""


def _check(given: _Check) -> Work:
    name = given.task
    if not registry.is_own(name) and name not in registry.names():
        raise ConfigError(f"{name} must be a task of your own: FILE.py:FUNCTION, or an entry point")
    if not registry.is_own(name):
        raise ConfigError(f"{name} is one of gril's own tasks, which its tests check")
    name = named_task(name) or name
    env = EnvConfig(name=name, options=given.options)

    def work() -> int:
        with heavy_imports(MakeDemosConfig(env=env)):
            from gril_jax.workflows import check_task
        return check_task.main(name, env.own_options, echo=echo)

    return work


@dataclass(frozen=True)
class _New:
    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
    """Name of the task: a word such as push_puck. NAME.py and test_NAME.py are written."""
    out: str = "."
    """Folder for the files, which must exist."""


def _new(given: _New) -> Work:
    fits = given.name.isidentifier() and given.name.isascii()
    if not fits or keyword.iskeyword(given.name):
        raise ConfigError(
            f"{given.name!r:.60} must be a name such as push_puck, of letters, digits, _"
        )
    folder = resources.files("gril_jax.workflows.skeleton")
    written = (folder / f"{kind}my_task.py" for kind in ("", "test_"))
    paths = {
        Path(given.out) / file.name.replace("my_task", given.name): file.read_text(encoding="utf-8")
        for file in written
    }
    for path in paths:
        require_new_file(path)

    def work() -> None:
        for path, text in paths.items():
            with writing(path.parent), new_file(path) as file:
                file.write(text.replace("my_task", given.name).encode())
        first = f"{Path(given.out) / given.name}.py:make"
        echo(f"wrote {' and '.join(map(str, paths))}")
        echo(f"next: gril check-task {first}, then gril demos make --task {first} --out mine")

    return work


VERBS = {
    "Demonstrations": (
        Verb("demos make [CONFIG]", "scripted demonstrations", _make, schema=_Make),
        simple(
            "demos import-videos DIR", "a demonstration set from a folder of videos",
            _Import, _videos,
        ),
    ),
    "A task of your own": (
        simple(
            "new-task NAME", "a task of your own that runs, to be changed, and its test",
            _New, _new,
        ),
        simple(
            "check-task FILE:make", "what a task of your own lacks, in sentences", _Check, _check,
        ),
    ),
}  # fmt: skip
