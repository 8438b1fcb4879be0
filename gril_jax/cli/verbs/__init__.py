"""The verbs of the command line, which modules of this package have as `VERBS`: by the titles of
the help, in its order. Nothing else names a verb."""

import importlib
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, TypeVar, Union

import tyro

from gril_jax.config import MakeDemosConfig
from gril_jax.config.command_line import parse
from gril_jax.errors import ConfigError

from ..arguments import Work, echo
from ..heavy_imports import heavy_imports

MODULES = ("training", "tasks", "rewards", "sweep", "machine")
COMPLETION = "--tyro-print-completion"

Options = TypeVar("Options")


class Verb(NamedTuple):
    """A verb, which its module has in `VERBS`."""

    usage: str  # "demos make [CONFIG]", its name first
    summary: str
    plan: Callable[[list[str]], Work]  # from the arguments; imports nothing heavy
    more: Mapping[str, str] = MappingProxyType({})  # further lines of the help: usage, summary
    schema: type[Any] | None = None  # the dataclass of its options

    @property
    def name(self) -> str:
        """The words that call it, such as "demos make"."""
        return re.match(r"[a-z\d-]+( [a-z\d-]+)*", self.usage)[0]

    @property
    def lines(self) -> dict[str, str]:
        """Everything that `gril --help` says of the verb."""
        return {self.usage: self.summary, **self.more}


def simple(
    usage: str,
    summary: str,
    schema: type[Options],
    work: Callable[[Options], Work],
) -> Verb:
    """A verb whose options are the fields of a dataclass, from which `work` makes what is left to
    do."""

    def plan(args: list[str]) -> Work:
        text = f"{summary[0].upper()}{summary[1:]}."
        return work(parse(schema, args, prog=f"gril {verb.name}", description=text))

    verb = Verb(usage, summary, plan, schema=schema)
    return verb


def experiment(
    name: str,
    *args: Any,
    config: MakeDemosConfig | None = None,
    devices: bool = False,
    **options: Any,
) -> Work:
    """The work of `gril_jax.workflows.NAME`: its `main` with these arguments and `echo`.

    `config` and `devices` are those of `heavy_imports`.
    """

    def work() -> None:
        with heavy_imports(config, devices=devices):
            module = importlib.import_module(f"gril_jax.workflows.{name}")
        module.main(*args, **options, echo=echo)

    return work


def table() -> dict[str, tuple[Verb, ...]]:
    """All verbs by their titles, in the order of the help."""
    modules = (importlib.import_module(f"{__name__}.{module}") for module in MODULES)
    return {title: verbs for module in modules for title, verbs in module.VERBS.items()}


def every() -> list[Verb]:
    """All verbs."""
    return [verb for members in table().values() for verb in members]


def print_completion(shell: list[str]) -> None:
    """Prints what lets the Tab key of a shell finish verbs and options, and exits; a ConfigError if
    there is no such shell."""
    if shell not in (["bash"], ["zsh"], ["fish"], ["tcsh"]):
        raise ConfigError(f"{COMPLETION} must be followed by one of bash, zsh, fish, tcsh")
    families: dict[str, list[Any]] = {}
    for verb in (verb for verb in every() if verb.schema):
        first, _, second = verb.name.partition(" ")
        mark = tyro.conf.subcommand(second or first, description=verb.summary)
        families.setdefault(first, []).append(Annotated[verb.schema, mark])
    members = [
        kinds[0] if len(kinds) == 1 else Annotated[Union[*kinds], tyro.conf.subcommand(first)]
        for first, kinds in families.items()
    ]
    tyro.cli(Union[*members], args=[COMPLETION, *shell], prog="gril")
