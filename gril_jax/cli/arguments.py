"""Paths, runs and tasks that arguments name, checked before anything heavy is imported.

A task's file that `--task` names is run. One that only a run or a configuration names is run if
this user has named it before, with the contents that it has now; see `envs.user_tasks.files`.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.tables import REWARDS
from gril_jax.config.task import NO_TASK
from gril_jax.demos.folders import left_by_system
from gril_jax.envs.user_tasks import files
from gril_jax.errors import ConfigError, DemoError, RunError, printable
from gril_jax.runs import places, reading, run_dir
from gril_jax.runs.reading import task_digest
from gril_jax.safe_files import writing

_ROUNDS = 2  # of hard negatives

Work = Callable[[], int | None]  # what is left to do once the command line is understood


def echo(text: str) -> None:
    """Prints a line or several, at once, also into a pipe."""
    print("\n".join(map(printable, text.split("\n"))), flush=True)


def run_config_of(
    folder: Path, part: str | None = None, *, task: str | None = None, demos: Path | None = None
) -> RunConfig:
    """The configuration of a run, with its `task` or a file of it, and the place of its `demos`,
    that are named beside the run.

    Raises RunError if the run has not got to a part, "reward" or "policy". Raises ConfigError if
    its task may not be run."""
    config = run_dir.read_config(folder, demos=demos)
    require_task_of(config, task, folder)
    if part is not None:
        reading.require_unchanged(folder, f"{part}/")
    if part is not None and not any(folder.glob(f"{part}/[0-9]*/manifest.json")):
        if part == "reward" and not REWARDS[config.run.reward_form].learns:
            raise RunError(
                f"{folder} has no learned reward: its policy was trained on run.reward "
                f"{config.run.reward!r}"
            )
        raise RunError(f"{folder} has no {part}, so its run has not got that far yet")
    return config


def hard_negatives(names: str, config: RunConfig) -> list[Path]:
    """The folders of the one or two runs whose policies give a new run hard negatives.

    More runs, runs without a policy, and those of another task or other blocks are an error."""
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


# --- folders and files


def existing_folder(name: str) -> Path:
    """The path of a folder; raises DemoError where there is none."""
    path = Path(name)
    if not path.is_dir():
        fault = "is a file" if path.exists() else "does not exist"
        raise DemoError(f"{path} {fault}, but must be a folder")
    return path


def demo_set(name: str) -> Path:
    """The path of a demonstration set; raises DemoError where there is none."""
    folder = existing_folder(name)
    if not (folder / "demos.json").is_file():
        raise DemoError(f"{folder} is not a demonstration set, because it has no demos.json")
    return folder


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
        held = [one.name for one in path.iterdir() if not left_by_system(one.name)]
        if held and not (path / "demos.json").is_file():
            raise DemoError(f"{path} holds other files, but --out must be new, empty or a demo set")
    else:
        run_dir.require_new(path)
    return path


# --- tasks of one's own


def named_task(task: str) -> str | None:
    """A file's function with its absolute path, which is named here and so may be run; None for
    tasks that are no files."""
    return str(_sentence(files.name, task)) if files.is_reference(task) else None


def named_detector(boxes: str) -> str:
    """The choice of boxes, in which a detector's file has the name of its function."""
    return (
        str(_sentence(files.reference, boxes, "detector")) if files.is_reference(boxes) else boxes
    )


def require_task_of(config: RunConfig, task: str | None, folder: Path) -> None:
    """Raises ConfigError if the task's file of a run may not be run, or has been changed.

    `task` is the file that is named beside the run, if one is."""
    if task is not None:
        own = files.is_reference(config.env.name) and files.is_reference(task)
        if config.env.name == NO_TASK:
            raise ConfigError(f"{folder} was trained on videos alone, so it has no use for --task")
        if not own and task != config.env.name:
            raise ConfigError(f"{folder} was trained for {config.env.name}, but --task is {task}")
        if own:
            _sentence(files.moved, config.env.name, task)
    elif files.is_reference(config.env.name):
        was = str(_sentence(files.reference, config.env.name).file)
        noted = task_digest(folder), places.candidates(folder, was)
        _sentence(files.look_for, config.env.name, *noted)
    require_task(config.env, folder)


def require_task(env: EnvConfig, folder: Path | None = None) -> None:
    """Raises ConfigError if the task is of a file that may not be run, or that is another one than
    the run in a folder has noted."""
    if files.is_reference(env.name):
        _sentence(files.require, env.name, None if folder is None else task_digest(folder))


def _sentence(function: Callable[..., Any], *args: Any) -> Any:
    try:
        return function(*args)
    except ValueError as error:
        raise ConfigError(str(error)) from None
