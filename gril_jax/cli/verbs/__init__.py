"""The verbs of the command line: `gril WORD` is the module WORD here, `gril WORD WORD` a folder's.

The table gives their order in the help. Nothing else names a verb: its module defines `VERB`.
"""

import importlib

from ..verb import Verb

__all__ = ["TABLE", "find", "names"]

TABLE: dict[str, tuple[str, ...]] = {
    "Learn a reward, and a policy from it": ("quickstart", "train", "report", "eval", "pretrain"),
    "Demonstrations": ("demos make", "demos import-videos", "demos import-magical"),
    "Look into a reward, take it elsewhere":
        ("audit", "subtasks", "export-reward", "export-policy"),
    "Compare, over seeds": ("sweep", "ablate", "soundness", "table1", "table2"),
    "This machine": (
        "doctor", "bench train", "bench env", "bench losses", "bench replay", "bench compile",
        "bench brax", "bench sac", "bench known",
    ),
}  # fmt: skip


def names() -> list[str]:
    """Every verb."""
    return [name for group in TABLE.values() for name in group]


def find(name: str) -> Verb:
    """The verb of this name; its module is imported, and no other verb's."""
    path = name.replace(" ", ".").replace("-", "_")
    return importlib.import_module(f"{__name__}.{path}").VERB
