"""Verbs that make demonstration sets."""

from dataclasses import dataclass, field, fields
from typing import Annotated, Literal

import tyro

from gril_jax.config import DemosConfig, EnvConfig, MakeDemosConfig
from gril_jax.config.rules import above, between, optional, rule
from gril_jax.config.run_config import Section
from gril_jax.config.task import Places
from gril_jax.errors import ConfigError

from .. import own_tasks
from ..arguments import Work, demo_set_to_write, existing_folder
from ..configured import ConfigName, read, start
from . import Verb, experiment, simple

_MAKE = "gril demos make"


@dataclass(frozen=True)
class _Make:
    """Make scripted demonstrations of a configuration's task."""

    config: ConfigName = None
    out: str | None = None
    """New folder of the demonstration set, which must be named."""
    variant: Places = "layout"
    """Variant of the starts."""
    seed: int = field(default=0, metadata=between(0, 2**31 - 1))
    """Seed of the starts and of the expert."""
    env: Section[EnvConfig] = field(default=EnvConfig())
    demos: tyro.conf.OmitArgPrefixes[Section[DemosConfig]] = field(default=DemosConfig())


def _make(args: list[str]) -> Work:
    given = read(_Make(), args, _MAKE, start)
    if given.out is None:
        raise ConfigError(f"{_MAKE} needs --out: see {_MAKE} --help")
    config = MakeDemosConfig(given.env, given.demos)
    own_tasks.require(config.env)
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
    the objects of MAGICAL's palette; module:function is a detector of yours, from frames to
    boxes."""
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


def _videos(given: _Import) -> Work:
    if given.task is not None:
        EnvConfig(name=given.task).check()
    if given.boxes == "colour" and given.half_extent is None:
        raise ConfigError("gril demos import-videos needs --half-extent where --boxes is colour")
    options = {one.name: getattr(given, one.name) for one in fields(_Import)}
    folders = existing_folder(options.pop("source")), demo_set_to_write(options.pop("out"))
    return experiment("import_videos", *folders, **options)


VERBS = (
    Verb("demos make [CONFIG]", "scripted demonstrations", _make, schema=_Make),
    simple(
        "demos import-videos DIR", "a demonstration set from a folder of videos", _Import, _videos
    ),
)
