"""`gril VERB`: the command line.

The command line is read, and every path on it looked at, before anything heavy is imported: a
misspelt option is answered at once. What a verb does lives in `gril_jax.experiments`, imported
when the verb runs. Exit codes: 0 done, 1 failed at work, 2 the command line is wrong, 130
interrupted.
"""

import contextlib
import io
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from . import doctor, run_dir
from .config import MakeDemosConfig, RunConfig, Variant
from .config_files import load
from .errors import ConfigError, DemoError, GrilError, RunError
from .options import nearest, parse

__all__ = ["main"]

Work = Callable[[], int | None]  # what is left to do once the command line is understood

_HELP = """\
usage: gril VERB [options]

Learn a reward from demonstration videos without actions, and a policy from the reward.

  quickstart                  a small run from demonstrations to a policy, on a laptop
  train [CONFIG]              the same for any configuration
  pretrain [CONFIG]           the learned reward alone
  demos make [CONFIG]         scripted demonstrations
  demos import-magical DIR    a demonstration set from MAGICAL's public demonstrations
  demos import-videos DIR     a demonstration set from a folder of videos
  eval RUN                    success rate and return of a run's policy
  report RUN                  figures and tables of a run
  export-policy RUN           a run's policy as plain NumPy arrays
  bench losses                the losses and encoders beside those of others, as JSON
  bench env                   how many control steps a second the task makes here, as JSON
  doctor                      what is installed and what works on this machine

CONFIG is the name of a shipped configuration or the path of a YAML file; RUN is the folder
that a run made. `gril VERB --help` lists the options of a verb.
"""

_SHORTCUTS = {"--out": "--run.out", "--demos": "--demos.path", "--seed": "--run.seed"}


@dataclass(frozen=True)
class _ImportMagical:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of *.pkl.gz files."""
    out: str
    """Folder of the demonstration set."""


@dataclass(frozen=True)
class _ImportVideos:
    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SOURCE")]
    """Folder of videos of one frame rate."""
    out: str
    """Folder of the demonstration set."""
    half_extent: float
    """Half the width of the world that a frame shows, in world units."""
    task: str = "match_regions"
    """The task's name."""
    boxes: bool = False
    """Read NAME.csv beside each video instead of detecting objects by colour."""
    outcome: Literal["success", "failure", "unknown"] = "unknown"
    """How all of the videos end."""


@dataclass(frozen=True)
class _Eval:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder that a run made."""
    episodes: int = 100
    """Episodes to play."""
    seed: int = 0
    """Seed of the episodes."""
    variant: Variant | None = None
    """What is drawn at the start; None keeps the run's own variant."""


@dataclass(frozen=True)
class _Report:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder that a run made."""


@dataclass(frozen=True)
class _ExportPolicy:
    run: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder that a run made."""
    out: str
    """File to create, such as policy.npz."""


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
class _Doctor:
    timeout_s: float = 120.0
    """Seconds that each check may take."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command line and returns the exit code; `sys.argv` where `argv` is None."""
    args = list(sys.argv[1:] if argv is None else argv)
    code = 2
    try:
        work = _plan(args)
        code = 1
        result = work() or 0
        sys.stdout.flush()  # here, where a pipe that is closed can still be answered for
        return result
    except GrilError as error:
        print(f"gril: {str(error).rstrip('.')}.", file=sys.stderr)
        return code
    except KeyboardInterrupt:
        print("gril: interrupted.", file=sys.stderr)
        return 130
    except SystemExit as stop:  # tyro has printed the help
        return 0 if stop.code is None else int(stop.code)
    except BrokenPipeError:  # the reader of a pipe has had enough, as in `gril --help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


def _plan(args: list[str]) -> Work:
    """Reads the command line; nothing heavy is imported here."""
    if not args or args[0] in ("-h", "--help"):
        print(_HELP, end="")
        return lambda: 0
    verb, rest = args[0], args[1:]
    if verb in ("demos", "bench"):
        if not rest or rest[0] in ("-h", "--help"):
            print(_HELP, end="")
            return lambda: 0
        verb, rest = f"{verb} {rest[0]}", rest[1:]
    if verb not in _VERBS:
        hint = nearest(verb, [*_VERBS])
        raise ConfigError(f"there is no verb {verb!r}{hint}: see gril --help")
    return _VERBS[verb](rest)


# --- the verbs


def _quickstart(args: list[str]) -> Work:
    return _plan_train("quickstart", args, "gril quickstart")


def _train(args: list[str]) -> Work:
    return _plan_train(_positional(args), args, "gril train")


def _plan_train(name: str | None, args: list[str], prog: str) -> Work:
    config = _run_config(name, args, prog, "Learn a reward, then a policy from it.")

    def work() -> None:
        with _heavy_imports():
            from .experiments import train
        train.main(config, echo=_echo)

    return work


def _pretrain(args: list[str]) -> Work:
    config = _run_config(_positional(args), args, "gril pretrain", "Learn a reward.")

    def work() -> None:
        with _heavy_imports():
            from .experiments import pretrain
        pretrain.main(config, echo=_echo)

    return work


def _make_demos(args: list[str]) -> Work:
    name, out = _positional(args), _take(args, "--out")
    about = "Make scripted demonstrations in the new folder that --out names."
    config = load(name, args, schema=MakeDemosConfig, prog="gril demos make", description=about)
    if out is None:
        raise ConfigError("gril demos make needs --out, the folder of the demonstration set")
    folder = _demo_set_to_write(out)

    def work() -> None:
        with _heavy_imports():
            from .experiments import make_demos
        make_demos.main(config, folder, echo=_echo)

    return work


def _import_magical(args: list[str]) -> Work:
    about = "Make a demonstration set from MAGICAL's public demonstrations."
    given = parse(_ImportMagical, args, prog="gril demos import-magical", description=about)
    source, out = _folder(given.source), _demo_set_to_write(given.out)

    def work() -> None:
        with _heavy_imports():
            from .interop import import_demos
        with _import_progress() as progress:
            import_demos.import_magical(source, out, progress=progress)
        _echo(f"wrote {out}")

    return work


def _import_videos(args: list[str]) -> Work:
    about = "Make a demonstration set from a folder of videos."
    given = parse(_ImportVideos, args, prog="gril demos import-videos", description=about)
    if not 0 < given.half_extent < float("inf"):
        raise ConfigError(f"--half-extent is {given.half_extent}, but must be finite and above 0")
    source, out = _folder(given.source), _demo_set_to_write(given.out)

    def work() -> None:
        with _heavy_imports():
            from .interop import import_demos
        with _import_progress() as progress:
            import_demos.import_videos(
                source,
                out,
                given.half_extent,
                given.task,
                given.boxes,
                outcome=given.outcome,
                progress=progress,
            )
        _echo(f"wrote {out}")

    return work


def _eval(args: list[str]) -> Work:
    given = parse(_Eval, args, prog="gril eval", description="Play a run's policy.")
    if given.episodes < 1:
        raise ConfigError(f"--episodes is {given.episodes}, but must be at least 1")
    if not 0 <= given.seed < 2**31:
        raise ConfigError(f"--seed is {given.seed}, but must be from 0 to {2**31 - 1}")
    folder = Path(given.run)
    run_dir.read_config(folder)

    def work() -> None:
        with _heavy_imports():
            from .experiments import evaluate
        evaluate.main(
            folder, episodes=given.episodes, seed=given.seed, variant=given.variant, echo=_echo
        )

    return work


def _report(args: list[str]) -> Work:
    given = parse(_Report, args, prog="gril report", description="Draw a run's figures.")
    folder = Path(given.run)
    run_dir.read_config(folder)

    def work() -> None:
        with _heavy_imports():
            from .experiments import report
        report.main(folder, echo=_echo)

    return work


def _export_policy(args: list[str]) -> Work:
    about = "Write a run's policy as an npz file that needs NumPy alone."
    given = parse(_ExportPolicy, args, prog="gril export-policy", description=about)
    folder, out = Path(given.run), Path(given.out)
    config = run_dir.read_config(folder)
    if not any(folder.glob("policy/[0-9]*/manifest.json")):
        raise RunError(f"{folder} has no policy, so its run has not got that far yet")
    _require_new_file(out)

    def work() -> None:
        with _heavy_imports():
            from . import export_policy
            from .experiments import setup
        algorithm = setup.make_ppo(config, setup.make_env(config.env, training=False))
        export_policy.main(folder, out, config, algorithm, setup.ppo_hyper(config), echo=_echo)

    return work


def _doctor(args: list[str]) -> Work:
    about = "Check what is installed and what works on this machine."
    given = parse(_Doctor, args, prog="gril doctor", description=about)

    def work() -> int:
        checks = doctor.check_all(timeout_s=given.timeout_s)
        _echo(doctor.table(checks))
        return doctor.exit_code(checks)

    return work


def _bench_env(args: list[str]) -> Work:
    about = "Control steps per second of the task on this machine, as JSON."
    given = parse(_BenchEnv, args, prog="gril bench env", description=about)

    def work() -> None:
        with _heavy_imports():
            from .experiments import bench_env
        bench_env.main(given.lanes, given.steps, given.repeats, levers=given.levers, echo=_echo)

    return work


def _bench_losses(args: list[str]) -> Work:
    about = "The losses and encoders beside those of other libraries, value plus gradient, as JSON."
    given = parse(_BenchLosses, args, prog="gril bench losses", description=about)
    if given.repeats < 1:
        raise ConfigError(f"--repeats is {given.repeats}, but must be at least 1")

    def work() -> None:
        with _heavy_imports():
            from .experiments import bench_losses
        bench_losses.main(given.repeats, echo=_echo)

    return work


_VERBS: dict[str, Callable[[list[str]], Work]] = {
    "quickstart": _quickstart,
    "train": _train,
    "pretrain": _pretrain,
    "demos make": _make_demos,
    "demos import-magical": _import_magical,
    "demos import-videos": _import_videos,
    "eval": _eval,
    "report": _report,
    "export-policy": _export_policy,
    "bench env": _bench_env,
    "bench losses": _bench_losses,
    "doctor": _doctor,
}

# --- reading and checking


def _run_config(name: str | None, args: list[str], prog: str, about: str) -> RunConfig:
    """The checked configuration of a run, whose paths are what they should be."""
    shortcuts = ", ".join(f"{short} for {long}" for short, long in _SHORTCUTS.items())
    about = f"{about} Shortcuts: {shortcuts}."
    for index, arg in enumerate(args):
        option, equals, value = arg.partition("=")
        args[index] = _SHORTCUTS.get(option, option) + equals + value
    config = load(name, args, prog=prog, description=about)
    if config.demos.path is not None:
        folder = _folder(config.demos.path)
        if not (folder / "demos.json").is_file():
            raise DemoError(f"{folder} is not a demonstration set, because it has no demos.json")
    if config.run.out is not None:
        run_dir.require_new(Path(config.run.out))
    return config


def _positional(args: list[str]) -> str | None:
    """Takes the leading word off the arguments, unless it is an option."""
    return args.pop(0) if args and not args[0].startswith("-") else None


def _take(args: list[str], option: str) -> str | None:
    """Takes an option with its value off the arguments; the last one counts."""
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


def _folder(name: str) -> Path:
    path = Path(name)
    if not path.is_dir():
        fault = "is a file" if path.exists() else "does not exist"
        raise DemoError(f"{path} {fault}, but must be a folder")
    return path


def _require_new_file(path: Path) -> None:
    with run_dir.writing(path.parent):  # a name may be too long, or a folder closed to us
        if path.exists() or path.is_symlink():
            raise RunError(f"{path} exists already, but --out must be a new file")
        if not path.parent.is_dir():
            fault = "is a file" if path.parent.exists() else "does not exist"
            raise RunError(f"{path.parent} {fault}, but --out must be in a folder that exists")


def _demo_set_to_write(name: str) -> Path:
    """A new or empty folder, or a demonstration set to replace."""
    path = Path(name)
    if path.is_dir():
        if any(path.iterdir()) and not (path / "demos.json").is_file():
            raise DemoError(f"{path} holds other files, but --out must be new, empty or a demo set")
    else:
        run_dir.require_new(path)
    return path


# --- running the work


@contextlib.contextmanager
def _heavy_imports() -> Iterator[None]:
    """Around imports of JAX and MuJoCo: sets the compilation cache and threads, keeps stdout clean.

    MJX reports on stdout, while it is imported, that optional parts are missing.
    """
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gril_jax" / "jax"
    with contextlib.suppress(OSError):  # without a writable cache everything works, only slower
        folder.mkdir(parents=True, exist_ok=True)
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder))
    # OpenCV's threads cost more than they bring on pictures this small.
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
    with contextlib.redirect_stdout(io.StringIO()):
        yield


@contextlib.contextmanager
def _import_progress() -> Iterator[Callable[..., None]]:
    from .progress import Progress

    with Progress() as progress:
        phase = progress.phase("reading", total=0, unit="demonstrations", compiles=False)

        def tell(done: int, total: int, last: object) -> None:
            phase.total = total
            phase.update(done)

        yield tell


def _echo(line: str) -> None:
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
