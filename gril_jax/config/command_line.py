"""Reads a command line into a dataclass with tyro; a mistake becomes one sentence.

tyro knows what is wrong, and says it in boxes for a terminal; here its findings become the sentence
of a `ConfigError`. What a newer tyro finds besides, it says itself.
"""

import dataclasses
import difflib
import functools
import typing
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, NamedTuple, TypeVar

import tyro
from tyro import _errors as events

from gril_jax.errors import ConfigError

from .tables import require

RunFolder = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(metavar="RUN", help="The folder that a run made."),
]

Schema = TypeVar("Schema")


# A value's form in tyro's help, and in words.
_FORMS = {
    "{None}|": "None or ",
    "[INT [INT ...]]": "whole numbers separated by spaces",
    "INT": "a whole number",
    "FLOAT": "a number",
    "STR": "a word",
}


def short(option: str) -> Any:
    """Annotation of a field that has a short option beside that in full."""
    return tyro.conf.arg(aliases=(option,))


class Option(NamedTuple):
    """An option of a command line."""

    path: tuple[str, ...]  # of its field, such as ("env", "name")
    kind: Any


def parse(
    schema: type[Schema],
    args: Sequence[str],
    *,
    default: Schema | None = None,
    prog: str,
    description: str | None = None,
    add_help: bool = True,
) -> Schema:
    """Reads options into a dataclass, above its `default`; `--help` prints tyro's help and exits
    with 0. A ConfigError says which option is unknown, lacks its value, is of the wrong type or out
    of range, or is missing."""
    asked = {"-h", "--help"} & {*args}
    # Comments are the help, and to find them takes tyro as long as everything else.
    marks = (tyro.conf.FlagCreatePairsOff, *(() if asked else (tyro.conf.HelptextFromCommentsOff,)))
    known = options(schema)
    with events.on_parse_error(functools.partial(_refuse, known)):
        given = tyro.cli(
            schema,
            args=_capitalised(args, known),
            default=tyro.MISSING_NONPROP if default is None else default,
            config=marks,
            prog=prog,
            description=description,
            add_help=add_help,
        )
    for field in dataclasses.fields(given):
        require(f"--{_spelt(field.name)}", getattr(given, field.name), field.metadata)
    return given


def options(schema: type[Any], path: tuple[str, ...] = ()) -> dict[str, Option]:
    """Every option of a dataclass by its spelling on the command line, with shortcuts."""
    found: dict[str, Option] = {}
    for name, kind in typing.get_type_hints(schema, include_extras=True).items():
        if typing.get_origin(kind) is typing.ClassVar:  # a constant
            continue
        marks = getattr(kind, "__metadata__", ())
        kind = kind.__origin__ if marks else kind
        if dataclasses.is_dataclass(kind):
            bare = tyro.conf.OmitArgPrefixes in marks
            inner = options(kind, () if bare else (*path, name))
            found |= {word: Option((name, one.path[-1]), one.kind) for word, one in inner.items()}
        elif tyro.conf.Positional not in marks:
            said = next((m for m in marks if hasattr(m, "aliases")), None)
            last = said.name if said and said.name else name
            for word in (f"--{_spelt('.'.join((*path, last)))}", *((said and said.aliases) or ())):
                found[word] = Option((*path, name), kind)
    return found


def _capitalised(args: Sequence[str], known: dict[str, Option]) -> list[str]:
    """The words with true and false, as YAML writes them, as Python does."""
    written, found = {"true": "True", "false": "False"}, []
    for before, word in zip(("", *args), args, strict=False):
        option, equals, value = word.partition("=")
        if _is_switch(option, known):
            word = option + equals + written.get(value, value)
        elif _is_switch(before, known):
            word = written.get(word, word)
        found.append(word)
    return found


def _is_switch(word: str, known: dict[str, Option]) -> bool:
    """True for an option that is true or false."""
    option = known.get(_spelt(word))
    return option is not None and bool in (option.kind, *typing.get_args(option.kind))


def nearest(word: str, known: Iterable[str]) -> str:
    """A hint in brackets that names the known word most like this one, or nothing."""
    last = word.rpartition(".")[2].lstrip("-")
    same = [name for name in known if name.rpartition(".")[2].lstrip("-") == last]
    close = same or difflib.get_close_matches(word, [*known], n=1, cutoff=0.6)
    return f" (did you mean {close[0]}?)" if close else ""


def _spelt(name: str) -> str:
    return name.replace("_", "-")


def _refuse(known: dict[str, Option], event: events.ParseErrorEvent) -> None:
    """Raises ConfigError for what tyro has found."""
    match event:
        case (
            events.UnrecognizedArgs(tokens=words)
            | events.MissingArgs(unrecognized_tokens=[_, *_] as words)
        ):
            said = _unknown(words, known)
        case events.MissingArgs(missing_arguments=missing):
            said = f"{event.prog} needs {', '.join(_name(one.arg) for one in missing)}"
        case events.BadValue(argument=argument):
            said = f"{_name(argument)} is given without a value, but must be {_form(argument)}"
        case events.InvalidChoice(argument=argument, value=value, choices=choices):
            said = f"{_name(argument)} is {value!r}, but must be one of {', '.join(choices)}"
        case events.InstantiationFailure(argument=argument) if argument is not None:
            why = event.message.splitlines()[-1].rpartition(">: ")[2]
            said = f"{_name(argument)} must be {_form(argument)}: {why}"
        case _:
            return
    raise ConfigError(f"{said}: see {event.prog} --help")


def _unknown(words: Sequence[str], known: dict[str, Option]) -> str:
    option = next((word.partition("=")[0] for word in words if word.startswith("-")), None)
    if option is None:
        return f"there is no use for {' '.join(words)!r}"
    return f"there is no option {option}{nearest(_spelt(option), [*known, '--help'])}"


def _name(argument: Any) -> str:
    """The option in full, also where a shortcut was typed; RUN of a word without one."""
    lowered = argument.lowered
    return str(lowered.metavar) if argument.is_positional() else lowered.name_or_flags[-1]


def _form(argument: Any) -> str:
    """The form that a value must have, in words."""
    form = str(argument.lowered.metavar)
    for written, words in _FORMS.items():
        form = form.replace(written, words)
    return form
