"""Verbs that make demonstration sets."""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from gril_jax.config import MakeDemosConfig
from gril_jax.config.command_line import parse
from gril_jax.config.files import load
from gril_jax.errors import ConfigError

from .arguments import (
    Work,
    demo_set_to_write,
    echo,
    existing_folder,
    explained,
    in_full,
    positional,
    take,
)
from .heavy_imports import heavy_imports

__all__ = ["VERBS"]


_MAKE = {
    "--num": "--demos.num",
    "--failures": "--demos.num-failures",
    "--variant": "--demos.variant",
    "--seed": "--demos.seed",
}


@dataclass(frozen=True)
class _ImportMagical:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of *.pkl.gz files."""
    out: str
    """Folder of the demonstration set."""


@dataclass(frozen=True)
class _ImportVideos:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of videos of one frame rate."""
    out: str
    """Folder of the demonstration set."""
    half_extent: float
    """Half the width of the world that a frame shows, in world units."""
    task: str = "match_regions"
    """The task's name."""
    boxes: bool = False
    """Read NAME.csv beside each video instead of detecting objects by colour."""
    outcome: Literal["success", "failure", "unknown"] = "unknown"
    """How all of the videos end."""


def _make_demos(args: list[str]) -> Work:
    name, out = positional(args), take(args, "--out")
    about = explained("Make scripted demonstrations in the new folder that --out names.", _MAKE)
    args, prog = in_full(args, _MAKE), "gril demos make"
    config = load(name, args, schema=MakeDemosConfig, prog=prog, description=about)
    if out is None:
        raise ConfigError("gril demos make needs --out, the folder of the demonstration set")
    folder = demo_set_to_write(out)

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.experiments.pipeline import make_demos
        make_demos.main(config, folder, echo=echo)

    return work


def _import_magical(args: list[str]) -> Work:
    about = "Make a demonstration set from MAGICAL's public demonstrations."
    given = parse(_ImportMagical, args, prog="gril demos import-magical", description=about)
    source, out = existing_folder(given.source), demo_set_to_write(given.out)

    def work() -> None:
        with heavy_imports():
            from gril_jax.demos import importing
        with _import_progress() as progress:
            importing.import_magical(source, out, progress=progress)
        echo(f"wrote {out}")

    return work


def _import_videos(args: list[str]) -> Work:
    about = "Make a demonstration set from a folder of videos."
    given = parse(_ImportVideos, args, prog="gril demos import-videos", description=about)
    if not 0 < given.half_extent < float("inf"):
        raise ConfigError(f"--half-extent is {given.half_extent}, but must be finite and above 0")
    source, out = existing_folder(given.source), demo_set_to_write(given.out)

    def work() -> None:
        with heavy_imports():
            pass
        with _import_progress() as progress:
            importing.import_videos(
                source,
                out,
                given.half_extent,
                given.task,
                given.boxes,
                outcome=given.outcome,
                progress=progress,
            )
        echo(f"wrote {out}")

    return work


@contextlib.contextmanager
def _import_progress() -> Iterator[Callable[..., None]]:
    from gril_jax.runs.progress import Progress

    with Progress() as progress:
        phase = progress.phase("reading", total=0, unit="demonstrations", compiles=False)

        def tell(done: int, total: int, last: object) -> None:
            phase.total = total
            phase.update(done)

        yield tell


VERBS: dict[str, Callable[[list[str]], Work]] = {
    "demos make": _make_demos,
    "demos import-magical": _import_magical,
    "demos import-videos": _import_videos,
}
