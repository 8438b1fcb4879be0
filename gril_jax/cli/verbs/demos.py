"""Verbs that make demonstration sets."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from gril_jax.config import DemosConfig, EnvConfig, MakeDemosConfig
from gril_jax.config.rules import above, between, optional, rule
from gril_jax.config.run_config import Section
from gril_jax.config.task import Places
from gril_jax.errors import ConfigError

from .. import own_tasks
from ..arguments import Work, demo_set_to_write, echo, existing_folder
from ..configured import ConfigName, read, start
from ..heavy_imports import heavy_imports
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
    """Folder of MAGICAL's *.pkl.gz files, of videos, or of a LeRobot dataset."""
    out: str
    """Folder of the demonstration set."""


@dataclass(frozen=True)
class _ImportVideos(_Import):
    half_extent: float | None = field(default=None, metadata=optional(above(0)))
    """Half the width of the world that a frame shows, in a unit of yours; with --boxes auto None
    measures in widths of the picture."""
    task: str | None = None
    """The task whose classes the boxes have; None, with --boxes auto, takes the boxes' own."""
    boxes: Literal["auto", "True", "False"] = "False"
    """auto reads the boxes beside each film, in any of the formats that are known, of any classes;
    True reads NAME.csv of a task's classes; False detects the blocks of match_regions by colour."""
    robot: tuple[str, ...] = ()
    """With auto: classes that are the robot, or the hand; what they do is no progress."""
    camera: str | None = None
    """The camera of a LeRobot dataset, if it has several."""
    track: str | None = None
    """A JSON file of boxes drawn on the first frame of each film, to be followed where no boxes are
    beside the films."""
    detector: str | None = None
    """A detector of yours, module:function, from frames to boxes, where no boxes are."""
    fps: float | None = field(default=None, metadata=optional(between(0.1, 1000)))
    """With auto: frames per second of the set; None is the slowest film's, at most 10."""
    jitter: float | None = field(default=None, metadata=optional(between(0, 1000)))
    """With auto: standard deviation of a box's place, pixels of the film; None estimates it."""
    smoothing: int | None = field(
        default=None, metadata=optional(rule(lambda x: 1 <= x < 1000 and x % 2 == 1, "odd"))
    )
    """With auto: frames of the film that boxes are smoothed over; None is 0.3 s if they jitter."""
    outcome: Literal["success", "failure", "unknown"] = "unknown"
    """Outcome of all the videos."""


_OWN = ("robot", "camera", "track", "detector", "fps", "jitter", "smoothing")


def _videos(given: _ImportVideos) -> Work:
    if given.boxes == "auto" or given.track or given.detector:
        if given.track and given.detector:
            raise ConfigError("--track and --detector are both given, but boxes come from one")
        if given.task is not None:
            EnvConfig(name=given.task).check()
        source, out = existing_folder(given.source), demo_set_to_write(given.out)
        options = {name: getattr(given, name) for name in ("half_extent", "task", "outcome")}
        options |= {name: getattr(given, name) for name in ("camera", "detector", *_OWN[4:])}
        options |= {"robots": given.robot, "track": Path(given.track) if given.track else None}
        return experiment("import_films", source, out, **options)
    for name in _OWN:
        if getattr(given, name) != getattr(_ImportVideos, name):
            raise ConfigError(f"--{name} is for films of your own, so it needs --boxes auto")
    if given.half_extent is None:
        raise ConfigError("--half-extent is missing, but must be given unless --boxes is auto")
    known = {"half_extent": given.half_extent, "task": given.task or EnvConfig.name}
    known |= {"boxes": given.boxes == "True", "outcome": given.outcome}
    return _import("videos", given, known)


def _import(kind: str, given: _Import, options: dict[str, Any]) -> Work:
    """The work of `gril_jax.demos.importing.import_KIND`, which tells its progress."""
    source, out = existing_folder(given.source), demo_set_to_write(given.out)

    def work() -> None:
        with heavy_imports():
            from gril_jax.demos import importing
            from gril_jax.runs.progress import Progress

        with Progress() as progress:
            phase = progress.phase("reading", total=0, unit="demonstrations", compiles=False)

            def tell(done: int, total: int, last: object) -> None:
                phase.total = total
                phase.update(done)

            getattr(importing, f"import_{kind}")(source, out, **options, progress=tell)
        echo(f"wrote {out}")

    return work


@dataclass(frozen=True)
class _ImportMagical(_Import):
    task: str | None = None
    """Task that the set is for, such as match_regions_magical; None is that of the recordings'
    name."""


def _magical(given: _ImportMagical) -> Work:
    if given.task is not None:
        EnvConfig(name=given.task).check()
    return _import("magical", given, {"task": given.task})


VERBS = (
    Verb("demos make [CONFIG]", "scripted demonstrations", _make, schema=_Make),
    simple(
        "demos import-videos DIR",
        "a demonstration set from a folder of videos",
        _ImportVideos,
        _videos,
    ),
    simple(
        "demos import-magical DIR",
        "a demonstration set from MAGICAL's public demonstrations",
        _ImportMagical,
        _magical,
    ),
)
