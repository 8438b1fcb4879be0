"""Verbs that say what works on this machine, and how fast; figures of benchmarks are JSON."""

import importlib
import json
from dataclasses import dataclass, field
from typing import Any, Literal

from gril_jax.config import TaskName, Variant
from gril_jax.config.files import load
from gril_jax.config.rules import count, optional

from .. import doctor
from ..arguments import Work, echo
from ..heavy_imports import heavy_imports
from . import Verb, simple

_PARTS = ("training", "seeds", "devices")


@dataclass(frozen=True)
class _Doctor:
    timeout_s: float = 120.0
    """Time limit of each check, seconds."""


def _doctor(given: _Doctor) -> Work:
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


def _benchmark(name: str, summary: str, options: type = _Nothing) -> Verb:
    """The verb of `gril_jax.experiments.bench.NAME`, whose `main` returns the figures."""

    def plan(given: Any) -> Work:
        chosen = vars(given)
        config = load(chosen["task"]) if "task" in chosen else None  # XLA's options depend on it

        def work() -> None:
            with heavy_imports(config):
                frame = importlib.import_module("gril_jax.experiments.bench.frame")
                module = importlib.import_module(f"gril_jax.experiments.bench.{name}")
            figures = module.main(**chosen)
            echo(json.dumps(frame.machine() | figures, indent=2))

        return work

    about = f"{summary[0].upper()}{summary[1:]}, as JSON."
    return simple(f"bench {name}", summary, options, plan, about=about)


VERBS = (
    simple(
        "doctor", "what is installed and what works on this machine", _Doctor, _doctor,
        about="Check what is installed and what works on this machine.",
    ),
    _benchmark("train", "training with and without the learned reward", _Train),
    _benchmark("env", "how many control steps a second the task makes here", _Env),
    _benchmark("losses", "the losses beside those of other libraries"),
)  # fmt: skip
