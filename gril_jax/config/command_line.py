"""Command-line options into a dataclass; every mistake becomes one sentence.

tyro does the parsing. It draws its complaints as boxes for a terminal and exits, so the box is
caught here and what it says is raised as a ConfigError. Neither JAX nor MuJoCo is imported
here.
"""

import contextlib
import dataclasses
import difflib
import io
import re
import typing
from collections.abc import Sequence
from typing import Any, TypeVar

import tyro

from gril_jax.errors import ConfigError

__all__ = ["nearest", "options", "parse"]

Schema = TypeVar("Schema")

_KINDS = {
    int: "a whole number",
    int | None: "a whole number",
    float | None: "a number",
    float: "a number",
    bool: "True or False",
    tuple[int, ...]: "whole numbers separated by spaces",
}


def parse(
    schema: type[Schema],
    args: Sequence[str],
    *,
    default: Schema | None = None,
    prog: str,
    description: str | None = None,
) -> Schema:
    """Reads options into a dataclass; `--help` prints the help and exits with 0.

    Raises:
      ConfigError: an option is unknown, lacks its value, is of the wrong type or out of range.
    """
    known = options(schema)
    for arg in args:
        if re.match(r"--?[A-Za-z]", arg) and arg != "-h":
            _check_name(arg.split("=")[0].replace("_", "-"), known, prog)
    printed = io.StringIO()
    try:
        with contextlib.redirect_stderr(printed):
            return tyro.cli(
                schema,
                args=[*args],
                default=tyro.MISSING_NONPROP if default is None else default,
                config=(tyro.conf.FlagConversionOff,),
                prog=prog,
                description=description,
            )
    except SystemExit as stop:
        if not stop.code:  # the help was asked for
            raise
    raise ConfigError(_sentence(printed.getvalue(), schema, prog))


def options(schema: type[Any], prefix: str = "--") -> dict[str, Any]:
    """Every option of a dataclass by its spelling on the command line, with its type."""
    found: dict[str, Any] = {}
    for name, kind in typing.get_type_hints(schema, include_extras=True).items():
        marks = getattr(kind, "__metadata__", ())
        kind = kind.__origin__ if marks else kind
        spelling = next((m.name for m in marks if getattr(m, "name", None)), name)
        option = prefix + spelling.replace("_", "-")
        if dataclasses.is_dataclass(kind):
            found |= options(kind, f"{option}.")
        elif tyro.conf.Positional not in marks:
            found[option] = kind
    return found


def nearest(word: str, known: Sequence[str]) -> str:
    """A hint in brackets that names the known word most like this one, or nothing."""
    last = word.rpartition(".")[2].lstrip("-")
    same = [name for name in known if name.rpartition(".")[2].lstrip("-") == last]
    close = same or difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f" (did you mean {close[0]}?)" if close else ""


def _check_name(option: str, known: dict[str, Any], prog: str) -> None:
    if option not in known and option != "--help":
        hint = nearest(option, [*known, "--help"])
        raise ConfigError(f"there is no option {option}{hint}: see {prog} --help")


def _sentence(box: str, schema: type[Any], prog: str) -> str:
    """What tyro's box says, up to its first rule, without the frame."""
    words: list[str] = []
    for line in box.splitlines()[1:]:
        text = line.strip("│ \t")
        if text.startswith("──"):
            break
        words.append(text)
    text = " ".join(words).removesuffix(".") or "the command line cannot be read"
    if match := re.match(r"[Uu]nrecognized options: (.*)", text):
        return f"there is no use for {match[1]!r}: see {prog} --help"
    if text.startswith("Missing from"):
        return f"{prog} needs {', '.join(_required(schema))}: see {prog} --help"
    if match := re.match(r"[Mm]issing value for argument '(\S+?)'", text):
        return f"{match[1]} is given without a value: see {prog} --help"
    if match := re.match(r"[Ii]nvalid choice '(.*)' for argument '(\S+?)'.*\((.*)\)", text):
        choices = match[3].replace("'", "")
        return f"{match[2]} is {match[1]!r}, but must be one of {choices}"
    if match := re.match(r"Error parsing (--[\w.-]+): (.*)", text):
        known = options(schema).get(match[1])
        kind = _KINDS.get(known, "of the form that --help shows")
        quoted = re.findall(r"'([^']*)'", match[2])
        # Of a union every member's complaint follows, each with the value again.
        given = quoted[0] if type(None) in typing.get_args(known) else " ".join(quoted)
        return f"{match[1]} is {given!r}, but must be {kind}"
    return text[0].lower() + text[1:]


def _required(schema: type[Any]) -> list[str]:
    """The spelling of every top-level field without a default."""
    named = options(schema)
    names = (f for f in dataclasses.fields(schema) if f.default is dataclasses.MISSING)
    spelt = [(f.name, "--" + f.name.replace("_", "-")) for f in names]
    return [option if option in named else name.upper() for name, option in spelt]
