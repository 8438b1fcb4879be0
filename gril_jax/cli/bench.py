"""The verbs that measure: each gives the options of one benchmark, whose figures are JSON."""

import importlib
import json
from dataclasses import dataclass

from gril_jax.config.command_line import parse

from .arguments import Work, echo
from .heavy_imports import heavy_imports
from .verb import Verb


@dataclass(frozen=True)
class NoOptions:
    """Nothing to choose."""


def benchmark(name: str, summary: str, options: type = NoOptions) -> Verb:
    """The verb of `gril_jax.experiments.bench.NAME`, whose `main` returns the figures.

    An option named `task` or `config` names a configuration.
    """

    def plan(args: list[str]) -> Work:
        from gril_jax.config.files import load

        about = f"{summary[0].upper()}{summary[1:]}, as JSON."
        given = vars(parse(options, args, prog=f"gril bench {name}", description=about))
        chosen = given.get("task", given.get("config"))
        config = None if chosen is None else load(chosen)  # XLA's options depend on the task

        def work() -> None:
            with heavy_imports(config):
                frame = importlib.import_module("gril_jax.experiments.bench.frame")
                module = importlib.import_module(f"gril_jax.experiments.bench.{name}")
            figures = module.main(**given)
            echo(json.dumps(frame.machine() | figures, indent=2))

        return work

    return Verb(f"bench {name}", summary, plan)
