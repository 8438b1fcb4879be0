"""The API reference: a page for each module that a stranger imports, from its docstrings.

    python -m gril_jax.experiments.docs.api_reference FOLDER

It needs pdoc: pip install 'gril-jax[docs]'.

Shapes are in the signatures; units, errors, source equations and doctests in the text.
"""

import importlib
import inspect
import re
import sys
from pathlib import Path
from types import ModuleType

import pdoc
import pdoc.render

__all__ = ["MODULES", "main"]

# The pure layer, then what saves, loads and adapts a reward. A package brings its modules along.
MODULES = (
    "types", "errors", "graphs", "encoders", "losses", "reward", "metrics", "subtasks", "audit",
    "pretraining.final_places", "pretraining.hard_negatives", "interop.reward_file",
    "interop.brax",
)  # fmt: skip

# How pdoc prints "Float[Array, ...]": with the modules that the names come from, in a signature
# as spans of their own, elsewhere in one piece.
_PREFIXES = re.compile(
    r'<span class="n">(jaxtyping|jaxlib|_jax|typing)</span><span class="o">.</span>'
    r"|(jaxtyping|jaxlib\._jax)\.(?=(Float|Bool|Int|PyTree|PRNGKeyArray|Array)\b)"
)


def main(folder: str | Path) -> list[Path]:
    """Writes the pages into a folder; returns those of `MODULES`."""
    names = [f"gril_jax.{name}" for name in MODULES]
    for name in names:
        _describe_fields(importlib.import_module(name))
    pdoc.render.configure(docformat="google")
    pdoc.pdoc(*names, output_directory=Path(folder))
    for page in Path(folder).rglob("*.html"):
        page.write_text(_PREFIXES.sub("", page.read_text(encoding="utf-8")), encoding="utf-8")
    return [Path(folder, *name.split(".")).with_suffix(".html") for name in names]


def _describe_fields(module: ModuleType) -> None:
    """Gives the fields of named tuples the comments beside them for docstrings."""
    for value in vars(module).values():
        ours = inspect.isclass(value) and value.__module__ == module.__name__
        if not ours or not hasattr(value, "_fields"):
            continue
        lines = inspect.getsource(value).splitlines()
        beside = (re.match(r"\s+(\w+):.*?#\s+(.*)", line) for line in lines)
        comments = dict(found.groups() for found in beside if found)
        for name in value._fields:
            getattr(value, name).__doc__ = comments.get(name, "")


if __name__ == "__main__":
    main(sys.argv[1])
