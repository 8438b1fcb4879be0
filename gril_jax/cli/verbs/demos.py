"""Verbs that make demonstration sets."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from gril_jax.config import MakeDemosConfig
from gril_jax.config.command_line import parse
from gril_jax.config.files import load
from gril_jax.config.rules import above
from gril_jax.errors import ConfigError

from .. import own_tasks
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


def _importing(kind: str, options: type[_Import], summary: str) -> Verb:
    """The verb of `gril_jax.demos.importing.import_KIND`, which tells its progress."""

    def plan(args: list[str]) -> Work:
        prog, about = f"gril demos import-{kind}", f"Make {summary}."
        given = dict(vars(parse(options, args, prog=prog, description=about)))
        source, out = existing_folder(given.pop("source")), demo_set_to_write(given.pop("out"))

        def work() -> None:
            with heavy_imports():
                from gril_jax.demos import importing
                from gril_jax.runs.progress import Progress

            with Progress() as progress:
                phase = progress.phase("reading", total=0, unit="demonstrations", compiles=False)

                def tell(done: int, total: int, last: object) -> None:
                    phase.total = total
                    phase.update(done)

                getattr(importing, f"import_{kind}")(source, out, **given, progress=tell)
            echo(f"wrote {out}")

        return work

    return Verb(f"demos import-{kind} DIR", summary, plan)


VERBS = (
    Verb("demos make [CONFIG]", "scripted demonstrations", _make),
    _importing("videos", _ImportVideos, "a demonstration set from a folder of videos"),
    _importing("magical", _Import, "a demonstration set from MAGICAL's public demonstrations"),
)
