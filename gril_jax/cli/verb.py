"""A verb of the command line: its lines of the help, and what turns its arguments into work."""

import importlib
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from gril_jax.config import MakeDemosConfig, RunConfig

from .arguments import Work, echo
from .heavy_imports import heavy_imports


class Verb(NamedTuple):
    """A verb, which its module has in `VERBS`."""

    usage: str  # "demos make [CONFIG]", its name first
    summary: str
    plan: Callable[[list[str]], Work]  # from the arguments; imports nothing heavy
    more: Mapping[str, str] = MappingProxyType({})  # further lines of the help: usage, summary

    @property
    def name(self) -> str:
        """The words that call it, such as "demos make"."""
        return re.match(r"[a-z\d-]+( [a-z\d-]+)*", self.usage)[0]

    @property
    def lines(self) -> dict[str, str]:
        """Everything that `gril --help` says of the verb."""
        return {self.usage: self.summary, **self.more}


def experiment(
    name: str,
    *args: Any,
    config: RunConfig | MakeDemosConfig | None = None,
    devices: bool = False,
    **options: Any,
) -> Work:
    """The work of `gril_jax.experiments.NAME`: its `main` with these arguments and `echo`.

    `config` and `devices` are those of `heavy_imports`.
    """

    def work() -> None:
        with heavy_imports(config, devices=devices):
            module = importlib.import_module(f"gril_jax.experiments.{name}")
        module.main(*args, **options, echo=echo)

    return work
