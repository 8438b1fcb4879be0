"""JSON of annotation tools, whose fields are checked where they are read."""

import json
from pathlib import Path
from types import UnionType
from typing import Any

from gril_jax.errors import DemoError

from .record import read_text

_MISSING = object()


def load(path: Path) -> Any:
    """A file's content; a DemoError with the line of a fault."""
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise DemoError(f"{path}, line {error.lineno}: not JSON ({error.msg}).") from None
    except (ValueError, RecursionError):
        raise DemoError(
            f"{path}: not JSON that can be read; it is nested too deeply, or a number has "
            "thousands of digits."
        ) from None


def field(
    holder: Any, name: str, kind: type | UnionType, where: str, default: Any = _MISSING
) -> Any:
    """A field of an object, of a type; the default where it is missing, if there is one."""
    if not isinstance(holder, dict):
        raise DemoError(f"{where}: must be an object with fields, not {holder!r:.60}.")
    value = holder.get(name, default)
    if value is _MISSING:
        raise DemoError(f"{where}: the field {name!r} is missing.")
    if value is not default and not isinstance(value, kind):
        raise DemoError(
            f"{where}: {name} must be {getattr(kind, '__name__', 'a number')}, not {value!r:.60}."
        )
    return value


def stem(name: str) -> str:
    """The stem of a file's name or address in a tool's own storage.

    >>> stem("/data/upload/7/kitchen_01.mp4")
    'kitchen_01'
    """
    return name.replace("\\", "/").rsplit("/", 1)[-1].split("?", 1)[0].rsplit(".", 1)[0]
