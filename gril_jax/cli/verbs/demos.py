"""Verbs that make demonstration sets."""

from dataclasses import dataclass, field, fields
from typing import Annotated, Literal

import tyro

from gril_jax.config import EnvConfig, MakeDemosConfig
from gril_jax.config.command_line import parse
from gril_jax.config.files import load
from gril_jax.config.rules import above, between, optional, rule
from gril_jax.errors import ConfigError

from .. import own_tasks
from ..arguments import (
    Work,
    demo_set_to_write,
    existing_folder,
    explained,
    in_full,
    positional,
    take,
)
from . import Verb, experiment

_SHORTCUTS = {
    "--task": "--env.name",
    "--num": "--demos.num",
    "--failures": "--demos.num-failures",
    "--variant": "--demos.variant",
    "--seed": "--demos.seed",
}


def _make(args: list[str]) -> Work:
    name, out = positional(args), take(args, "--out")
    args = own_tasks.named(in_full(args, _SHORTCUTS))
    if name is None and own_tasks.is_named(args):
        name = own_tasks.CONFIG
    config = load(
        name,
        args,
        schema=MakeDemosConfig,
        prog="gril demos make",
        description=explained(
            "Make scripted demonstrations in the new folder that --out names.", _SHORTCUTS
        ),
    )
    if out is None:
        raise ConfigError("gril demos make needs --out, the folder of the demonstration set")
    own_tasks.noted(config, args)
    folder = demo_set_to_write(out)
    return experiment("build.make_demos", config, folder, config=config, devices=True)


@dataclass(frozen=True)
class _Import:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of videos, of MAGICAL's *.pkl.gz files, or of a LeRobot dataset."""
    out: str
    """Folder of the demonstration set."""
    boxes: str = "auto"
    """auto reads the boxes beside each video, in any of the formats that are known; colour finds
    the objects of MAGICAL's palette; FILE.json has boxes drawn on one frame of each video, to be
    followed; module:function is a detector of yours, from frames to boxes."""
    half_extent: float | None = field(default=None, metadata=optional(above(0)))
    """Half the width of the world that a frame shows, in a unit of yours; None measures in widths
    of the picture."""
    task: str | None = None
    """The task whose classes the boxes have; None takes the boxes' own."""
    robot: tuple[str, ...] = ()
    """Classes that are the robot, or the hand; what they do is no progress."""
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


def _videos(args: list[str]) -> Work:
    prog = f"gril {_VIDEOS.name}"
    given = parse(_Import, args, prog=prog, description=f"Make {_VIDEOS.summary}.")
    if given.task is not None:
        EnvConfig(name=given.task)  # a ConfigError if there is none
    if given.boxes == "colour" and given.half_extent is None:
        raise ConfigError(f"{prog} needs --half-extent where --boxes is colour")
    options = {one.name: getattr(given, one.name) for one in fields(_Import)}
    folders = existing_folder(options.pop("source")), demo_set_to_write(options.pop("out"))
    return experiment("import_videos", *folders, **options)


@dataclass(frozen=True)
class _ImportMagical:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of MAGICAL's *.pkl.gz files."""
    out: str
    """Folder of the demonstration set."""
    task: str | None = None
    """Task that the set is for, such as match_regions_magical; None is that of the recordings'
    name."""


def _magical(args: list[str]) -> Work:
    about = f"Make {_MAGICAL.summary}."
    given = parse(_ImportMagical, args, prog=f"gril {_MAGICAL.name}", description=about)
    if given.task is not None:
        EnvConfig(name=given.task)  # a ConfigError if there is none
    folders = existing_folder(given.source), demo_set_to_write(given.out)
    return experiment("import_videos", *folders, task=given.task, boxes="colour")


_VIDEOS = Verb("demos import-videos DIR", "a demonstration set from a folder of videos", _videos)
_MAGICAL = Verb(
    "demos import-magical DIR",
    "a demonstration set from MAGICAL's public demonstrations",
    _magical,
)
VERBS = (Verb("demos make [CONFIG]", "scripted demonstrations", _make), _VIDEOS, _MAGICAL)
