"""Words of a command line that verbs of tables take off it themselves."""

from collections.abc import Mapping

from gril_jax.config import RunConfig
from gril_jax.config.command_line import options
from gril_jax.errors import ConfigError

from . import help_page
from .configured import ConfigName, RunOptions, dataclass, new_run, read_run


@dataclass(frozen=True)
class Run(RunOptions):
    """A configuration by its name, and its options."""

    config: ConfigName = None


def run_config(
    name: str | None,
    args: list[str],
    prog: str,
    about: str,
    sections: help_page.Sections | None = None,
    *,
    own: Mapping[str, str] | None = None,
) -> RunConfig:
    """The configuration of a new run, with its values and paths checked."""
    page = help_page.Page(prog, about, sections or help_page.SWEEP, own or {})
    words = args if name is None else [name, *args]
    return new_run(read_run(Run(), words, page), prog)


def positional(args: list[str]) -> str | None:
    """Removes and returns the leading argument, unless it is an option."""
    return args.pop(0) if args and not args[0].startswith("-") else None


def take(args: list[str], option: str) -> str | None:
    """Removes an option and returns its value; the last one counts."""
    value = None
    for index in reversed(range(len(args))):
        name, equals, rest = args[index].partition("=")
        if name == option:
            if not equals and index + 1 >= len(args):
                raise ConfigError(f"{option} is given without a value")
            found = rest if equals else args.pop(index + 1)
            args.pop(index)
            value = found if value is None else value
    return value


def whole_number(args: list[str], option: str, usual: int | None, least: int = 1) -> int | None:
    """Takes a whole number off the arguments that is not below the least; the usual without it."""
    text = take(args, option)
    if text is None:
        return usual
    if not text.isdecimal() or int(text) < least:
        raise ConfigError(f"{option} is {text!r}, but must be a whole number of at least {least}")
    return int(text)


def in_full(args: list[str]) -> list[str]:
    """The arguments with shortcuts expanded."""
    known = options(RunConfig)
    full = {one.path: word for word, one in known.items() if "." in word}
    parts = (arg.partition("=") for arg in args)
    return [
        (full[known[word].path] if word in known else word) + equals + value
        for word, equals, value in parts
    ]
