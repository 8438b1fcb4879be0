"""`gril demos import-videos`: a folder of videos as a demonstration set."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from gril_jax.config.command_line import parse
from gril_jax.config.rules import above

from ...arguments import Work, demo_set_to_write, existing_folder
from ...imported import imported
from ...verb import Verb


@dataclass(frozen=True)
class _Options:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of videos of one frame rate."""
    out: str
    """Folder of the demonstration set."""
    half_extent: float = field(metadata=above(0))
    """Half the width of the world that a frame shows, in world units."""
    task: str = "match_regions"
    """The task's name."""
    boxes: bool = False
    """Read NAME.csv beside each video instead of detecting objects by colour."""
    outcome: Literal["success", "failure", "unknown"] = "unknown"
    """Outcome of all the videos."""


def _plan(args: list[str]) -> Work:
    about = "Make a demonstration set from a folder of videos."
    given = parse(_Options, args, prog="gril demos import-videos", description=about)
    source, out = existing_folder(given.source), demo_set_to_write(given.out)
    options = (given.half_extent, given.task, given.boxes)
    return imported("import_videos", source, out, *options, outcome=given.outcome)


VERB = Verb("demos import-videos DIR", "a demonstration set from a folder of videos", _plan)
