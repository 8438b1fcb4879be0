"""`gril demos import-magical`: MAGICAL's public demonstrations as a demonstration set."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from gril_jax.config.command_line import parse

from ...arguments import Work, demo_set_to_write, existing_folder
from ...imported import imported
from ...verb import Verb


@dataclass(frozen=True)
class _Options:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of *.pkl.gz files."""
    out: str
    """Folder of the demonstration set."""


def _plan(args: list[str]) -> Work:
    about = "Make a demonstration set from MAGICAL's public demonstrations."
    given = parse(_Options, args, prog="gril demos import-magical", description=about)
    source, out = existing_folder(given.source), demo_set_to_write(given.out)
    return imported("import_magical", source, out)


VERB = Verb(
    "demos import-magical DIR", "a demonstration set from MAGICAL's public demonstrations", _plan
)
