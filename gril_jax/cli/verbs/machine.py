"""Verbs that say what works on this machine, and how fast; figures of benchmarks are JSON."""

import importlib
import json
from dataclasses import dataclass, field
from typing import Annotated, Literal

import tyro

from gril_jax.config import TaskName, Variant
from gril_jax.config.command_line import parse
from gril_jax.config.files import load
from gril_jax.config.rules import above, count, optional
from gril_jax.config.tables import ALGORITHMS
from gril_jax.errors import ConfigError

from .. import completion, doctor
from ..arguments import Work, echo
from ..heavy_imports import heavy_imports
from . import Verb

_PARTS = ("training", "starts", "seeds", "devices")
_TASKS = ("pendulum", "inverted_pendulum", "reacher")


@dataclass(frozen=True)
class _Doctor:
    timeout_s: float = 120.0
    """Time limit of each check, seconds."""


def _doctor(args: list[str]) -> Work:
    about = "Check what is installed and what works on this machine."
    given = parse(_Doctor, args, prog="gril doctor", description=about)

    def work() -> int:
        checks = doctor.check_all(timeout_s=given.timeout_s)
        echo(doctor.table(checks))
        return doctor.exit_code(checks)

    return work


@dataclass(frozen=True)
class _Nothing:
    """Nothing to choose."""


@dataclass(frozen=True)
class _Train:
    num_envs: int | None = field(default=None, metadata=optional(count()))
    """Environments; None is 256 on a CPU and 8,192 elsewhere."""
    engine: Literal["auto", "kernel", "impulse"] = "auto"
    """Physics solver."""
    variant: Variant = "demo"
    """Quantities randomised at the start of an episode."""
    parts: tuple[Literal[*_PARTS], ...] = _PARTS
    """Parts to measure; devices only where there are several."""
    repeats: int = field(default=5, metadata=count())
    """Timed calls of each program."""


@dataclass(frozen=True)
class _Env:
    task: TaskName = "match_regions"
    """The task to step."""
    num_envs: int | None = field(default=None, metadata=optional(count()))
    """Episodes in parallel; None is 256 on a CPU, and elsewhere 32,768, or 4,096 for the shoes."""
    steps: int = field(default=20, metadata=count())
    """Control steps of each timed run."""
    settings: bool = False
    """Measure every setting of the solver, and other engines, instead of the default alone."""


@dataclass(frozen=True)
class _Compile:
    config: str = "quickstart"
    """Configuration whose programs are compiled."""


@dataclass(frozen=True)
class _Brax:
    seeds: int = field(default=3, metadata=count())
    """Long runs of each."""


@dataclass(frozen=True)
class _SAC:
    num_envs: int = field(default=64, metadata=count())
    """Number of our environments that are stepped together."""
    target: float | None = field(default=None, metadata=optional(above(0)))
    """Success rate of training episodes to reach; None measures speeds only."""


@dataclass(frozen=True)
class _Known:
    tasks: tuple[Literal[*_TASKS], ...] = _TASKS
    """Tasks to train on."""
    algorithms: tuple[Literal[*ALGORITHMS], ...] = tuple(ALGORITHMS)
    """Algorithms to train with."""
    seeds: int = field(default=3, metadata=count())
    """Runs of each."""
    jobs: int | None = field(default=None, metadata=optional(count()))
    """Processes at a time; None is one for every two processor cores."""


def _benchmark(name: str, summary: str, options: type = _Nothing) -> Verb:
    """The verb of `gril_jax.experiments.bench.NAME`, whose `main` returns the figures.

    An option named `task` or `config` names a configuration.
    """

    def plan(args: list[str]) -> Work:
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


@dataclass(frozen=True)
class _Completion:
    shell: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SHELL")]
    """The shell: bash, zsh or fish."""


def _completion(args: list[str]) -> Work:
    about = 'Print what finishes words of gril in a shell: eval "$(gril completion bash)".'
    given = parse(_Completion, args, prog="gril completion", description=about)
    if given.shell not in completion.SHELLS:
        known = ", ".join(completion.SHELLS)
        raise ConfigError(f"the shell is {given.shell!r}, but must be one of {known}")
    return lambda: echo(completion.script(given.shell), end="")


VERBS = (
    Verb(
        "completion SHELL", "what lets the Tab key of bash, zsh or fish finish words", _completion
    ),
    Verb("doctor", "what is installed and what works on this machine", _doctor),
    _benchmark("train", "training with and without the learned reward", _Train),
    _benchmark("env", "how many control steps a second the task makes here", _Env),
    _benchmark("losses", "the losses beside those of other libraries"),
    _benchmark("replay", "the replay buffer beside brax's, alone and for eight seeds"),
    _benchmark(
        "compile", "seconds to compile each program of a run, and how many there are", _Compile
    ),
    _benchmark("brax", "our PPO beside brax's own on one pendulum", _Brax),
    _benchmark("sac", "our SAC beside a loop on the host, as with Gymnasium", _SAC),
    _benchmark(
        "known", "PPO and SAC where good returns are known, beside brax's and published", _Known
    ),
)
