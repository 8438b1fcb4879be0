"""Parses command-line options into a dataclass; every mistake becomes one sentence.

The words of a command line are first held against the dataclass's own types and ranges. tyro, whose
complaints are boxes for a terminal, then reads what is known to be right, and prints the help.
"""

import contextlib
import dataclasses
import difflib
import io
import re
import types
import typing
from collections.abc import Sequence
from typing import Annotated, Any, Literal, TypeVar

import tyro

from gril_jax.errors import ConfigError

from .rules import require

RunFolder = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(metavar="RUN", help="The folder that a run made."),
]

Schema = TypeVar("Schema")

_KINDS = {
    int: "a whole number",
    int | None: "a whole number",
    float | None: "a number",
    float: "a number",
    tuple[int, ...]: "whole numbers separated by spaces",
}


def parse(
    schema: type[Schema],
    args: Sequence[str],
    *,
    default: Schema | None = None,
    prog: str,
    description: str | None = None,
    before: Sequence[str] = (),
) -> Schema:
    """Parses options into a dataclass; `--help` prints the help and exits with 0. A ConfigError
    says which option is unknown, lacks its value, is of the wrong type or out of range, or which
    of the words that belong `before` the options comes behind them."""
    _check(schema, args, prog, before, complete=default is not None)
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            given = tyro.cli(
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
        raise ConfigError(f"the command line cannot be read: see {prog} --help") from None
    for field in dataclasses.fields(given):
        require(f"--{_spelt(field.name)}", getattr(given, field.name), field.metadata)
    return given


def options(schema: type[Any], prefix: str = "--") -> dict[str, Any]:
    """Every option of a dataclass by its command-line spelling, with its type."""
    found: dict[str, Any] = {}
    for name, kind in typing.get_type_hints(schema, include_extras=True).items():
        if typing.get_origin(kind) is typing.ClassVar:  # a constant
            continue
        marks = getattr(kind, "__metadata__", ())
        kind = kind.__origin__ if marks else kind
        spelling = next((m.name for m in marks if getattr(m, "name", None)), name)
        option = prefix + _spelt(spelling)
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


def _spelt(name: str) -> str:
    return name.replace("_", "-")


def _check(
    schema: type[Any], args: Sequence[str], prog: str, before: Sequence[str], *, complete: bool
) -> None:
    """Raises ConfigError for the first word that the dataclass has no use for, or lacks."""
    known = options(schema)
    given, loose = _sorted_words(args, known, prog)
    if {"-h", "--help"} & given.keys():
        return
    for option, words in given.items():
        _check_value(option, words, known[option], prog)
    top = {"--" + _spelt(field.name): field for field in dataclasses.fields(schema)}
    places = [
        option
        for option, field in top.items()
        if option not in known and not dataclasses.is_dataclass(field.default)
    ]
    if stray := loose[len(places) :]:
        late = " (a configuration is named before the options)" if stray[0] in before else ""
        raise ConfigError(f"there is no use for {' '.join(stray)!r}{late}: see {prog} --help")
    required = {
        option if option in known else field.name.upper(): option in given
        for option, field in top.items()
        if field.default is dataclasses.MISSING
    }
    present = sum(required.values()) + len(loose)
    if not complete and present < len(required):
        raise ConfigError(f"{prog} needs {', '.join(required)}: see {prog} --help")


def _sorted_words(
    args: Sequence[str], known: dict[str, Any], prog: str
) -> tuple[dict[str, list[str]], list[str]]:
    """The words that each option is given, and those that belong to no option."""
    given: dict[str, list[str]] = {}
    loose: list[str] = []
    words, room = loose, 0.0  # the list that the next word belongs to, and for how many
    for arg in args:
        if re.match(r"--?[A-Za-z]", arg):
            name, equals, value = arg.partition("=")
            option = _spelt(name)
            if option not in known and option not in ("-h", "--help"):
                hint = nearest(option, [*known, "--help"])
                raise ConfigError(f"there is no option {option}{hint}: see {prog} --help")
            words = given[option] = [value] if equals else []
            room = _room(known.get(option)) - len(words)
        elif room > 0:
            words.append(arg)
            room -= 1
        else:
            loose.append(arg)
    return given, loose


def _members(kind: Any) -> tuple[Any, ...]:
    """The types that an option may be of."""
    is_union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    return typing.get_args(kind) if is_union else (kind,)


def _room(kind: Any) -> int | float:
    """The number of words that an option of this type takes."""
    items = typing.get_args(kind) if typing.get_origin(kind) is tuple else (kind,)
    return float("inf") if items[-1] is Ellipsis else len(items)


def _check_value(option: str, words: list[str], kind: Any, prog: str) -> None:
    if not words and _room(kind) < float("inf"):
        raise ConfigError(f"{option} is given without a value: see {prog} --help")
    if _fits(words, kind):
        return
    if typing.get_origin(kind) is tuple and (choices := _choices(typing.get_args(kind)[0])):
        stray = next(word for word in words if word not in choices)
        raise ConfigError(f"{option} has {stray!r}, but must be of {', '.join(choices)}")
    choices = _choices(kind)
    known = _KINDS.get(kind, "of the form that --help shows")
    right = f"one of {', '.join(choices)}" if choices else known
    raise ConfigError(f"{option} is {' '.join(words)!r}, but must be {right}")


def _choices(kind: Any) -> list[str]:
    """The words that a type of few values has; empty for a number or a text."""
    found: list[str] = []
    for member in _members(kind):
        if typing.get_origin(member) is Literal:
            found += typing.get_args(member)
        elif member is bool:
            found += ["True", "False"]
    return found + ["None"] * (bool(found) and type(None) in _members(kind))


def _fits(words: list[str], kind: Any) -> bool:
    if typing.get_origin(kind) is tuple:
        items = typing.get_args(kind)
        if items[-1] is not Ellipsis and len(words) != len(items):
            return False
        return all(_fits([word], items[0]) for word in words)
    if choices := _choices(kind):
        return words[0] in choices
    return any(_reads(words[0], member) for member in _members(kind))


def _reads(word: str, kind: Any) -> bool:
    if kind is type(None):
        return word == "None"
    try:
        kind(word)
    except ValueError:
        return False
    return True
