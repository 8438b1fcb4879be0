"""The verb that looks for ways to cheat a reward."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from gril_jax.config import TaskName, Variant
from gril_jax.config.command_line import parse
from gril_jax.config.files import load
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import run_dir

from .arguments import Work, echo
from .heavy_imports import heavy_imports

__all__ = ["VERBS"]


@dataclass(frozen=True)
class _Audit:
    reward: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="REWARD_OR_RUN")]
    """A file of export-reward, or the folder that a run made."""
    task: TaskName | None = None
    """The task; a run's own, or match_regions."""
    out: str | None = None
    """Folder for the results; by default RUN/audit, or NAME-audit beside NAME.npz."""
    variant: Variant | None = None
    """What is drawn at the start; None keeps the run's own variant."""
    ascents: int = 1000
    """Gradient ascents of the search for well-paid states without progress."""
    starts: int = 4
    """Starts of episodes, around which all states are made."""
    seed: int = 0
    """Seed of everything that is drawn."""


def _audit(args: list[str]) -> Work:
    about = "Find how a learned reward could be cheated, before a policy does."
    given = parse(_Audit, args, prog="gril audit", description=about)
    for name in ("ascents", "starts"):
        if getattr(given, name) < 1:
            raise ConfigError(f"--{name} is {getattr(given, name)}, but must be at least 1")
    if not 0 <= given.seed < 2**31:
        raise ConfigError(f"--seed is {given.seed}, but must be from 0 to {2**31 - 1}")
    source = Path(given.reward)
    config = load(given.task) if given.task else None  # XLA's options depend on the task
    if source.is_dir():
        config = run_dir.read_config(source)
        if not any(source.glob("reward/[0-9]*/manifest.json")):
            raise RunError(f"{source} has no reward, so its run has not got that far yet")
    elif not source.is_file():
        raise RunError(f"{source} does not exist, but must be a reward file or the folder of a run")
    out = None if given.out is None else Path(given.out)
    if out is not None and out.exists() and not out.is_dir():
        raise RunError(f"{out} is a file, but --out must be a folder")

    def work() -> None:
        with heavy_imports(config, devices=True):
            from gril_jax.experiments import audit
        audit.main(
            source, task=given.task, out=out, variant=given.variant, ascents=given.ascents,
            starts=given.starts, seed=given.seed, echo=echo,
        )  # fmt: skip

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {"audit": _audit}
