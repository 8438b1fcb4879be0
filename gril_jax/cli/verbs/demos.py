"""Verbs that make demonstration sets."""

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import tyro

from gril_jax.config import MakeDemosConfig
from gril_jax.config.command_line import parse
from gril_jax.config.files import load
from gril_jax.config.rules import above
from gril_jax.errors import ConfigError

from ..arguments import (
    Work,
    demo_set_to_write,
    echo,
    existing_folder,
    explained,
    in_full,
    positional,
    take,
)
from ..heavy_imports import heavy_imports
from . import Verb, experiment

_SHORTCUTS = {
    "--num": "--demos.num",
    "--failures": "--demos.num-failures",
    "--variant": "--demos.variant",
    "--seed": "--demos.seed",
}


def _make(args: list[str]) -> Work:
    name, out = positional(args), take(args, "--out")
    config = load(
        name,
        in_full(args, _SHORTCUTS),
        schema=MakeDemosConfig,
        prog="gril demos make",
        description=explained(
            "Make scripted demonstrations in the new folder that --out names.", _SHORTCUTS
        ),
    )
    if out is None:
        raise ConfigError("gril demos make needs --out, the folder of the demonstration set")
    folder = demo_set_to_write(out)
    return experiment("pipeline.make_demos", config, folder, config=config, devices=True)


@dataclass(frozen=True)
class _Import:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of MAGICAL's *.pkl.gz files, or of videos of one frame rate."""
    out: str
    """Folder of the demonstration set."""


@dataclass(frozen=True)
class _ImportVideos(_Import):
    half_extent: float = field(metadata=above(0))
    """Half the width of the world that a frame shows, in world units."""
    task: str = "match_regions"
    """The task's name."""
    boxes: bool = False
    """Read NAME.csv beside each video instead of detecting objects by colour."""
    outcome: Literal["success", "failure", "unknown"] = "unknown"
    """Outcome of all the videos."""


def _import_magical(args: list[str]) -> Work:
    about = "Make a demonstration set from MAGICAL's public demonstrations."
    given = parse(_Import, args, prog="gril demos import-magical", description=about)
    return _imported("import_magical", given)


def _import_videos(args: list[str]) -> Work:
    about = "Make a demonstration set from a folder of videos."
    given = parse(_ImportVideos, args, prog="gril demos import-videos", description=about)
    options = (given.half_extent, given.task, given.boxes)
    return _imported("import_videos", given, *options, outcome=given.outcome)


def _imported(function: str, given: _Import, *args: Any, **options: Any) -> Work:
    """A set made by a function of `gril_jax.demos.importing`, which tells its progress."""
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

            getattr(importing, function)(source, out, *args, **options, progress=tell)
        echo(f"wrote {out}")

    return work


VERBS = (
    Verb("demos make [CONFIG]", "scripted demonstrations", _make),
    Verb("demos import-videos DIR", "a demonstration set from a folder of videos", _import_videos),
    Verb(
        "demos import-magical DIR",
        "a demonstration set from MAGICAL's public demonstrations",
        _import_magical,
    ),
)
