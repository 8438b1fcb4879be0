"""Verbs that measure this machine and what is installed on it."""

from collections.abc import Callable
from dataclasses import dataclass

from .. import doctor
from ..errors import ConfigError
from ..options import parse
from .arguments import Work, echo, heavy_imports

__all__ = ["VERBS"]


@dataclass(frozen=True)
class _BenchEnv:
    lanes: int | None = None
    """Episodes in parallel; None is 256 on a CPU and 32,768 elsewhere."""
    steps: int = 20
    """Control steps of each timed run."""
    repeats: int = 5
    """Timed runs, of which the best counts."""
    levers: bool = False
    """Measure every setting of the solver, and the MJX engine, instead of the default alone."""


@dataclass(frozen=True)
class _BenchLosses:
    repeats: int = 15
    """Timed calls of each form, whose median counts."""


@dataclass(frozen=True)
class _BenchReplay:
    repeats: int = 7
    """Timed calls of each form, whose median counts."""


@dataclass(frozen=True)
class _Doctor:
    timeout_s: float = 120.0
    """Seconds that each check may take."""


def _doctor(args: list[str]) -> Work:
    about = "Check what is installed and what works on this machine."
    given = parse(_Doctor, args, prog="gril doctor", description=about)

    def work() -> int:
        checks = doctor.check_all(timeout_s=given.timeout_s)
        echo(doctor.table(checks))
        return doctor.exit_code(checks)

    return work


def _bench_env(args: list[str]) -> Work:
    about = "Control steps per second of the task on this machine, as JSON."
    given = parse(_BenchEnv, args, prog="gril bench env", description=about)

    def work() -> None:
        with heavy_imports():
            from ..experiments import bench_env
        bench_env.main(given.lanes, given.steps, given.repeats, levers=given.levers, echo=echo)

    return work


def _bench_losses(args: list[str]) -> Work:
    about = "The losses and encoders beside those of other libraries, value plus gradient, as JSON."
    given = parse(_BenchLosses, args, prog="gril bench losses", description=about)
    if given.repeats < 1:
        raise ConfigError(f"--repeats is {given.repeats}, but must be at least 1")

    def work() -> None:
        with heavy_imports():
            from ..experiments import bench_losses
        bench_losses.main(given.repeats, echo=echo)

    return work


def _bench_replay(args: list[str]) -> Work:
    about = "The replay of soft actor-critic beside brax's, alone and with 8 seeds, as JSON."
    given = parse(_BenchReplay, args, prog="gril bench replay", description=about)
    if given.repeats < 1:
        raise ConfigError(f"--repeats is {given.repeats}, but must be at least 1")

    def work() -> None:
        with heavy_imports():
            from ..experiments import bench_replay
        bench_replay.main(given.repeats, echo=echo)

    return work


VERBS: dict[str, Callable[[list[str]], Work]] = {
    "bench env": _bench_env,
    "bench losses": _bench_losses,
    "bench replay": _bench_replay,
    "doctor": _doctor,
}
