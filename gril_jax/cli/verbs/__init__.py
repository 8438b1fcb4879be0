"""The verbs of the command line, which the modules of this package list as `VERBS`.

The table gives their order in the help. Nothing else names a verb.
"""

import importlib

from ..verb import Verb

__all__ = ["TABLE", "find", "group", "names"]

TABLE: dict[str, tuple[str, ...]] = {
    "Learn a reward, and a policy from it": ("training",),
    "Demonstrations": ("demos",),
    "Look into a reward, take it elsewhere": ("rewards",),
    "Compare, over seeds": ("sweep", "tables"),
    "This machine": ("machine",),
}


def group(title: str) -> list[Verb]:
    """The verbs below a title of the help, in order."""
    modules = (importlib.import_module(f"{__name__}.{module}") for module in TABLE[title])
    return [verb for module in modules for verb in module.VERBS]


def names() -> list[str]:
    """Every verb."""
    return [verb.name for title in TABLE for verb in group(title)]


def find(name: str) -> Verb:
    """The verb of this name, which is one of `names`."""
    return next(verb for title in TABLE for verb in group(title) if verb.name == name)
