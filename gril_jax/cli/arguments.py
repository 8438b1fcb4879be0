"""Arguments that verbs share, read and checked before anything heavy is imported."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from pathlib import Path

from gril_jax.config import RewardSections, RunConfig
from gril_jax.config.files import load
from gril_jax.config.task import NO_TASK
from gril_jax.errors import ConfigError, DemoError, RunError
from gril_jax.runs import covered, run_dir, sinks
from gril_jax.runs.phases import changed_fields
from gril_jax.safe_files import writing

from . import help_page, own_films, own_tasks

_ROUNDS = 2  # of hard negatives

Work = Callable[[], int | None]  # what is left to do once the command line is understood
echo = functools.partial(print, flush=True)  # at once, also into a pipe

SHORTCUTS = {
    "--task": "--env.name",
    "--out": "--run.out",
    "--demos": "--demos.path",
    "--seed": "--run.seed",
    "--reward": "--run.reward",
    "--algorithm": "--run.algorithm",
    "--lambda": "--loss.lambda",
}


def run_config(
    name: str | None,
    args: list[str],
    prog: str,
    about: str,
    sections: Mapping[str, tuple[str, ...]] | None = None,
    *,
    own: Mapping[str, str] | None = None,
    films_alone: bool = False,
) -> RunConfig:
    """The configuration of a run, with its values and paths checked; with `films_alone` it may be
    one without a task.

    The arguments then name the task's file by its digest, too, should it be one's own, and say how
    much the boxes of the set that they name jitter. Where the
    `sections` of a short help are given, --help prints that, and --help-all all options; `own` are
    the texts of options that the verb alone has.
    """
    if sections is not None:
        _help(name, args, prog, about, sections, own or {})
    args[:] = own_tasks.named(in_full(args))
    if name is None and own_tasks.is_named(args):
        name = own_tasks.CONFIG
    args[:] = own_films.with_noise(name, args)
    config = load(name, args, prog=prog, description=explained(about))
    config = own_tasks.noted(config, args)
    if config.env.name == NO_TASK and not films_alone:
        raise ConfigError(
            f"env.name is {NO_TASK}, but {prog} needs a task to play: a reward from films alone is "
            "learned by gril pretrain"
        )
    if config.env.name == NO_TASK and config.demos.path is None:
        raise ConfigError("env.name is none, so --demos must name a demonstration set of films")
    check_surroundings(config)
    if config.run.out is not None:
        run_dir.require_new(Path(config.run.out))
    return config


def _help(
    name: str | None,
    args: list[str],
    prog: str,
    about: str,
    sections: Mapping[str, tuple[str, ...]],
    own: Mapping[str, str],
) -> None:
    """Prints the help that is asked for and exits; of a verb without a policy no options of one."""
    if "--help-all" in args:
        schema = RewardSections if sections is help_page.PRETRAIN else RunConfig
        load(name, ["--help"], schema=schema, prog=prog, description=explained(about))
    if {"-h", "--help"} & {*args}:
        given = "" if prog == "gril quickstart" else " [CONFIG]"
        first = "".join(f" [{option}]" for option in [*own][:2]) or " [--task FILE:make]"
        films = " [--demos SET]" if any("--demos" in names for names in sections.values()) else ""
        usage = f"{prog}{given}{first}{films} [--resume RUN] [options]"
        config = load(name, prog=prog) if name else RunConfig()
        echo(help_page.page(usage, about, sections, config, SHORTCUTS, own), end="")
        raise SystemExit(0)


def resumed_config(
    folder: Path, name: str | None, args: list[str], *, prog: str, experiment: str
) -> RunConfig:
    """The configuration of a run to resume; a ConfigError with the fields in which the `name` and
    `args` given beside it say something else."""
    config = run_dir.require_resumable(folder, experiment)
    own_tasks.of_run(config, take(args, "--task"), folder)
    args = in_full(args)
    given = load(name or str(folder / "config.yaml"), args, prog=prog)
    if not any(arg.startswith("--run.out") for arg in args):
        given = dataclasses.replace(given, run=dataclasses.replace(given.run, out=config.run.out))
    if changed := changed_fields(config, given):
        raise ConfigError(
            f"a resumed run keeps the configuration in {folder / 'config.yaml'}, but the command "
            f"line gives {', '.join(changed)}"
        )
    check_surroundings(config)
    return config


def hard_negatives(names: str, config: RunConfig) -> list[Path]:
    """The folders of the one or two runs whose policies give a new run hard negatives; an error if
    these are more, have no policy, or are of another task or other blocks than the new run."""
    folders = [Path(name) for name in names.split(",") if name]
    if not 1 <= len(folders) <= _ROUNDS:
        raise ConfigError(
            f"--hard-negatives names {len(folders)} runs, but must be one run, or two with a comma "
            "between them"
        )
    for folder in folders:
        of = run_config_of(folder, "policy").env
        for field in ("name", "targets", "distractors"):
            theirs, ours = getattr(of, field), getattr(config.env, field)
            if theirs != ours:
                raise ConfigError(
                    f"--hard-negatives: {folder} has env.{field} {theirs!r}, but must have that of "
                    f"the new run, {ours!r}"
                )
    return folders


def run_config_of(folder: Path, part: str | None = None, *, task: str | None = None) -> RunConfig:
    """The configuration of a run; a RunError if it has not got to a part, "reward" or "policy", and
    a ConfigError if its task may not be run, which may be a file that is named beside the run."""
    config = run_dir.read_config(folder)
    own_tasks.of_run(config, task, folder)
    if part is not None:
        covered.require_part(folder, part)
    if part is not None and not any(folder.glob(f"{part}/[0-9]*/manifest.json")):
        raise RunError(f"{folder} has no {part}, so its run has not got that far yet")
    return config


def in_full(args: list[str], shortcuts: Mapping[str, str] = SHORTCUTS) -> list[str]:
    """The arguments with shortcuts expanded."""
    parts = (arg.partition("=") for arg in args)
    return [shortcuts.get(option, option) + equals + value for option, equals, value in parts]


def explained(about: str, shortcuts: Mapping[str, str] = SHORTCUTS) -> str:
    """A verb's description, with its shortcuts."""
    return f"{about} Shortcuts: {', '.join(f'{a} for {b}' for a, b in shortcuts.items())}."


def check_surroundings(config: RunConfig) -> None:
    """Raises if a run lacks what it needs beside its configuration."""
    sinks.require_installed(config.run.sinks)
    if config.demos.path is not None:
        folder = existing_folder(config.demos.path)
        if not (folder / "demos.json").is_file():
            raise DemoError(f"{folder} is not a demonstration set, because it has no demos.json")


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


def existing_folder(name: str) -> Path:
    """The path of a folder; raises DemoError where there is none."""
    path = Path(name)
    if not path.is_dir():
        fault = "is a file" if path.exists() else "does not exist"
        raise DemoError(f"{path} {fault}, but must be a folder")
    return path


def require_new_file(path: Path) -> None:
    """Raises RunError unless a file can be created here."""
    with writing(path.parent):  # a name may be too long, or a folder closed to us
        if path.exists() or path.is_symlink():
            raise RunError(f"{path} exists already, but --out must be a new file")
        if not path.parent.is_dir():
            fault = "is a file" if path.parent.exists() else "does not exist"
            raise RunError(f"{path.parent} {fault}, but --out must be in a folder that exists")


def demo_set_to_write(name: str) -> Path:
    """Checks that a path is a new or empty folder, or a demonstration set to replace."""
    path = Path(name)
    if path.is_dir():
        if any(path.iterdir()) and not (path / "demos.json").is_file():
            raise DemoError(f"{path} holds other files, but --out must be new, empty or a demo set")
    else:
        run_dir.require_new(path)
    return path
