"""Docstrings as the API pages show them: an extension of griffe, which reads the sources.

Doctests and indented blocks become blocks of code; the comment beside a field of a named tuple is
the field's description.
"""

import re
from typing import Any

from griffe import Attribute, Docstring, Extension, Object

_FIELD = re.compile(r"\s+\w+:.*?#\s+(.*)")
# A block of code: a doctest with what it prints, or four and more spaces after an empty line.
_DOCTEST = re.compile(r"(?:^>>> .*\n?(?:(?!\n).+\n?)*)", re.MULTILINE)


class Docstrings(Extension):
    """Changes the docstring of everything that is read."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Called for each module, class, function and attribute."""
        if obj.docstring is not None:
            obj.docstring.value = _DOCTEST.sub(_fenced, obj.docstring.value)
        if isinstance(obj, Attribute) and obj.docstring is None and obj.lineno is not None:
            found = _FIELD.match(obj.lines[0]) if obj.lines and obj.parent.is_class else None
            if found:
                obj.docstring = Docstring(found[1], parent=obj)


def _fenced(found: re.Match) -> str:
    return f"```pycon\n{found[0].rstrip()}\n```\n"
