"""Verbs that measure this machine and what is installed on it."""

from collections.abc import Callable
from dataclasses import dataclass

from gril_jax.config import TaskName, Variant
from gril_jax.config.command_line import parse
from gril_jax.config.files import load
from gril_jax.errors import ConfigError

from . import doctor
from .arguments import Work, echo
from .heavy_imports import heavy_imports

__all__ = ["VERBS"]


@dataclass(frozen=True)
class _BenchEnv:
    task: TaskName = "match_regions"
    """What to step."""
    lanes: int | None = None
    """Episodes in parallel; None is 256 on a CPU, and elsewhere 32,768, or 4,096 for the shoes."""
    steps: int = 20
    """Control steps of each timed run."""
    repeats: int = 5
    """Timed runs, of which the best counts."""
    settings: bool = False
    """Measure every setting of the solver, and other engines, instead of the default alone."""


@dataclass(frozen=True)
class _BenchLosses:
    repeats: int = 15
    """Timed calls of each form, whose median counts."""


@dataclass(frozen=True)
class _BenchReplay:
    repeats: int = 7
    """Timed calls of each form, whose median counts."""


@dataclass(frozen=True)
class _BenchTrain:
    lanes: int | None = None
    """Environments; None is 256 on a CPU and 8,192 elsewhere."""
    unroll: int | None = None
    """Control steps of each environment between two updates; None is 20."""
    updates: int | None = None
    """Updates of a timed call; None is 1 on a CPU and 5 elsewhere."""
    seed_lanes: int | None = None
    """Environments of each of the eight seeds; None is 64 on a CPU and 512 elsewhere."""
    seed_updates: int | None = None
    """Updates of each seed's whole training; None is 4 on a CPU and 50 elsewhere."""
    separate: int | None = None
    """Seeds that are really run one by one; None is 1 on a CPU and 2 elsewhere."""
    repeats: int = 5
    """Timed calls of each program."""
    variant: Variant = "demo"
    """What is drawn at the start of an episode."""
    varied_starts: float = 0.5
    """Share of episodes that start with the targets somewhere else."""
    parts: tuple[str, ...] = ("training", "starts", "seeds", "devices")
    """What to measure."""


@dataclass(frozen=True)
class _BenchCompile:
    config: str = "quickstart"
    """Configuration whose programs are compiled."""
    runs: bool = True
    """Whether to count what small runs of the whole pipeline compile, too."""


@dataclass(frozen=True)
class _BenchBrax:
    repeats: int = 3
    """Short runs of each, in processes of their own, of which the fastest counts."""
    seeds: int = 3
    """Long runs of each."""
    num_timesteps: int = 400_000
    """Control steps of a long run."""


@dataclass(frozen=True)
class _BenchKnown:
    tasks: tuple[str, ...] = ("pendulum", "inverted_pendulum", "reacher")
    """Tasks to train on."""
    algorithms: tuple[str, ...] = ("ppo", "sac")
    """Algorithms to train with."""
    seeds: int = 3
    """Runs of each."""
    jobs: int | None = None
    """Processes at a time; None is one for each two processor cores."""


@dataclass(frozen=True)
class _BenchSac:
    num_envs: int = 64
    """Environments of ours that are stepped together."""
    unroll_length: int = 4
    """Control steps of each between two rounds of gradient steps."""
    updates_per_step: int = 8
    """Gradient steps of such a round."""
    batch_size: int = 256
    """Transitions that a gradient step draws."""
    replay_size: int = 2**17
    """Transitions that the replay holds."""
    min_replay: int = 2**12
    """Transitions before learning begins."""
    hidden: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers."""
    learning_rate: float = 1e-3
    """Of actor, critics and temperature."""
    discounting: float = 0.97
    """Discount of a control step."""
    repeats: int = 5
    """Timed calls of each, of which the best counts."""
    target: float | None = None
    """Success of training episodes to reach; None measures speeds only."""
    limit_s: float = 600.0
    """Seconds after which either gives up."""


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
    about = "Control steps per second of a task on this machine, as JSON."
    given = parse(_BenchEnv, args, prog="gril bench env", description=about)

    def work() -> None:
        with heavy_imports(load(given.task)):  # XLA's options depend on the task
            from gril_jax.experiments.bench import env as bench_env
        bench_env.main(
            given.lanes, given.steps, given.repeats, task=given.task, settings=given.settings,
            echo=echo,
        )  # fmt: skip

    return work


def _bench_losses(args: list[str]) -> Work:
    about = "The losses and encoders beside those of other libraries, value plus gradient, as JSON."
    given = parse(_BenchLosses, args, prog="gril bench losses", description=about)
    if given.repeats < 1:
        raise ConfigError(f"--repeats is {given.repeats}, but must be at least 1")

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.bench import losses as bench_losses
        bench_losses.main(given.repeats, echo=echo)

    return work


def _bench_replay(args: list[str]) -> Work:
    about = "The replay of soft actor-critic beside brax's, alone and with 8 seeds, as JSON."
    given = parse(_BenchReplay, args, prog="gril bench replay", description=about)
    if given.repeats < 1:
        raise ConfigError(f"--repeats is {given.repeats}, but must be at least 1")

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.bench import replay as bench_replay
        bench_replay.main(given.repeats, echo=echo)

    return work


def _bench_train(args: list[str]) -> Work:
    about = "Training with either reward beside its environment alone, starts and seeds, as JSON."
    given = parse(_BenchTrain, args, prog="gril bench train", description=about)
    _require_counts(given, "lanes", "unroll", "updates", "seed_lanes", "seed_updates", "separate",
                    "repeats")  # fmt: skip
    _require_known(given, "parts")
    options = dict(vars(given))
    task = {name: options.pop(name) for name in ("variant", "varied_starts")}
    repeats, parts = options.pop("repeats"), options.pop("parts")
    sizes = {name: value for name, value in options.items() if value is not None}

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.bench import train as bench_train
        bench_train.main(sizes, repeats, parts=parts, echo=echo, **task)

    return work


def _bench_compile(args: list[str]) -> Work:
    about = "Seconds to compile each program of a run, and how many there are, as JSON."
    given = parse(_BenchCompile, args, prog="gril bench compile", description=about)
    load(given.config)

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.bench import compile as bench_compile
        bench_compile.main(config=given.config, runs=given.runs, echo=echo)

    return work


def _bench_brax(args: list[str]) -> Work:
    about = "Our PPO beside brax's own on one pendulum, as JSON."
    given = parse(_BenchBrax, args, prog="gril bench brax", description=about)
    _require_counts(given, "repeats", "seeds", "num_timesteps")

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.bench import brax
        brax.main(**vars(given), echo=echo)

    return work


def _bench_known(args: list[str]) -> Work:
    about = "PPO and SAC where good returns are known, beside brax's own and published, as JSON."
    given = parse(_BenchKnown, args, prog="gril bench known", description=about)
    _require_counts(given, "seeds", "jobs")
    _require_known(given, "tasks", "algorithms")

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.bench import known as bench_known
        bench_known.main(**vars(given), echo=echo)

    return work


def _bench_sac(args: list[str]) -> Work:
    about = "Our SAC beside a loop on the host, as users of Gymnasium write it, as JSON."
    given = parse(_BenchSac, args, prog="gril bench sac", description=about)
    _require_counts(given, "num_envs", "unroll_length", "updates_per_step", "batch_size", "repeats")

    def work() -> None:
        with heavy_imports():
            from gril_jax.experiments.bench import sac
        sac.main(**vars(given), echo=echo)

    return work


def _require_counts(given: object, *names: str) -> None:
    """Numbers of which there is at least one."""
    for name in names:
        value = getattr(given, name)
        if value is not None and value < 1:
            option = "--" + name.replace("_", "-")
            raise ConfigError(f"{option} is {value}, but must be at least 1")


def _require_known(given: object, *names: str) -> None:
    """Lists of which each entry is one of the default."""
    for name in names:
        known = getattr(type(given), name)
        if stray := [value for value in getattr(given, name) if value not in known]:
            raise ConfigError(f"--{name} has {stray[0]!r}, but must be of {', '.join(known)}")


VERBS: dict[str, Callable[[list[str]], Work]] = {
    "bench brax": _bench_brax,
    "bench compile": _bench_compile,
    "bench env": _bench_env,
    "bench known": _bench_known,
    "bench losses": _bench_losses,
    "bench replay": _bench_replay,
    "bench sac": _bench_sac,
    "bench train": _bench_train,
    "doctor": _doctor,
}
