"""Paths and runs that arguments name, checked before anything heavy is imported."""

import functools
from collections.abc import Callable
from pathlib import Path

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, DemoError, RunError
from gril_jax.runs import reading, run_dir
from gril_jax.safe_files import writing

from . import own_tasks

_ROUNDS = 2  # of hard negatives

Work = Callable[[], int | None]  # what is left to do once the command line is understood
echo = functools.partial(print, flush=True)  # at once, also into a pipe


def run_config_of(folder: Path, part: str | None = None, *, task: str | None = None) -> RunConfig:
    """The configuration of a run; a RunError if it has not got to a part, "reward" or "policy", and
    a ConfigError if its task may not be run, which may be a file that is named beside the run."""
    config = run_dir.read_config(folder)
    own_tasks.of_run(config, task, folder)
    if part is not None:
        reading.require_unchanged(folder, f"{part}/")
    if part is not None and not any(folder.glob(f"{part}/[0-9]*/manifest.json")):
        raise RunError(f"{folder} has no {part}, so its run has not got that far yet")
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
