"""Writes docs/options.md, the reference of all options: `python docs/options.py`.

The text of an option is the string under its field in `gril_jax/config`.
"""

import ast
import dataclasses
import inspect
import textwrap
import typing
from pathlib import Path

from gril_jax.config.run_config import Sections

PAGE = Path(__file__).with_name("options.md")
_HEAD = """\
# Options

Every option of `gril train`, by section. A command line takes each as it stands in the table. A
YAML file has the sections as keys, and Python takes them as keywords.

```bash
gril train quickstart --ppo.num-envs 256
```

```py
gril.train_policy("match_regions", reward, preset="quickstart", ppo={"num_envs": 256})
```

`gril sweep` takes several values with commas. A preset in `configs/` sets what fits its task. The
defaults below hold where it says nothing.
"""


def page() -> str:
    """The page's text."""
    parts = [_HEAD]
    for section in dataclasses.fields(Sections):
        kind = type(section.default)
        about = inspect.getdoc(kind).split("\n\n")[0].replace("\n", " ")
        rows = [_row(section.name, field, text) for field, text in _texts(kind)]
        parts.append(
            f"## {section.name}\n\n{about}\n\n| option | default | values | meaning |\n"
            "| --- | --- | --- | --- |\n" + "\n".join(rows) + "\n"
        )
    return "\n".join(parts)


def _texts(kind: type) -> list[tuple[dataclasses.Field, str]]:
    """The fields of a section with the strings under them, those of its bases included."""
    texts = {}
    for one in reversed(kind.__mro__[:-1]):
        (tree,) = ast.parse(textwrap.dedent(inspect.getsource(one))).body
        for field, below in zip(tree.body, tree.body[1:], strict=False):
            if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr):
                texts[field.target.id] = " ".join(below.value.value.split())
    return [(field, texts[field.name]) for field in dataclasses.fields(kind)]


def _row(section: str, field: dataclasses.Field, text: str) -> str:
    default = field.default
    if isinstance(default, tuple):
        default = " ".join(map(str, default)) or "none"
    name = field.name.rstrip("_").replace("_", "-")
    cells = [f"`--{section}.{name}`", f"`{default}`", _values(field), text]
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _values(field: dataclasses.Field) -> str:
    """The values that the option may have, in words."""
    kind = field.type
    if typing.get_origin(kind) is typing.Annotated:
        kind = typing.get_args(kind)[0]
    if typing.get_origin(kind) is typing.Literal:
        return ", ".join(f"`{value}`" for value in typing.get_args(kind))
    if kind is bool:
        return "`True`, `False`"
    if "text" in field.metadata:
        return field.metadata["text"].removeprefix("finite and ")
    return "text" if kind in (str, str | None) else ""


if __name__ == "__main__":
    PAGE.write_text(page())
