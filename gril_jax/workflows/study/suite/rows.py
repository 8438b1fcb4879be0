"""The rows of a suite: its tasks, each with a learned reward and with the task's own score.

Policies learn in Demo, or with the same reward in a variant: "find_dupe from films in layout". In
"films in all" everything is drawn anew for each episode, and one policy then plays all variants.
"""

import dataclasses
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, DemoError
from gril_jax.workflows.study.rows import AuditedSettings, Rows

TASKS = (
    "move_to_region", "move_to_corner", "fix_colour", "find_dupe", "match_regions_magical",
    "make_line", "cluster_shape", "cluster_colour",
)  # fmt: skip
_FOLDERS = {"match_regions_magical": "match-regions"}  # of films, where not by the task's name
LEARNED, SCORE, EVERYWHERE = "films", "its score", "films in all"
_FROM = " from "
# The reward is that of Demo's films, frozen; so are the frames that training begins at, in the
# colours, shapes and places of the variant.
_IN_VARIANT = {"run.reward": "learned"}
_REWARDS: dict[str, dict[str, Any]] = {
    LEARNED: {"run.reward": "learned"},
    EVERYWHERE: _IN_VARIANT | {"env.variant": "all"},
    **{
        f"{LEARNED} in {variant}": _IN_VARIANT | {"env.variant": variant}
        for variant in ("jitter", "color", "shape", "layout", "countplus", "dynamics")
    },
    SCORE: {"run.reward": "environmental", "run.reward_offset": 0.0},
}
_LACKS = {"move_to_corner": ("layout", "countplus"), "move_to_region": ("shape", "countplus")}
FILMS = "*.pkl.gz", "*.mp4"
# Steps of a task's policies, as shares of the configuration's: long tasks take longer to learn.
_STEPS = {
    "move_to_region": 0.5, "move_to_corner": 0.5, "fix_colour": 0.5, "make_line": 2.0,
    "cluster_shape": 2.0, "cluster_colour": 2.0,
}  # fmt: skip
_OPTIONS = ("physics=magical",)  # and of all tasks but one room for the blocks of any variant
_IN_ALL = 2.0  # and where everything is drawn anew for each episode
HOW = (
    "clone https://github.com/qxcv/magical-data, whose folders, such as find-dupe, hold the films "
    "as they were published"
)


def row_name(task: str, reward: str) -> str:
    """The name of a row."""
    return f"{task}{_FROM}{reward}"


def parts(row: str) -> tuple[str, str]:
    """The task and the reward of a row."""
    task, _, reward = row.partition(_FROM)
    return task, reward


def rows(sets: Path, steps: int) -> Rows:
    """The rows of all tasks, whose demonstration sets are in a folder; `steps` are those of a
    policy in a task of middle length."""
    return {
        row_name(task, reward): {
            "env.name": task,
            "env.reward": "sparse",
            "env.observation": "plain",
            "env.options": _OPTIONS if task == "match_regions" else (*_OPTIONS, "padded=True"),
            "demos.path": str(sets / task),
            "ppo.num_timesteps": round(
                _STEPS.get(task, 1.0) * (_IN_ALL if reward == EVERYWHERE else 1.0) * steps
            ),
        }
        | change
        for reward, change in _REWARDS.items()
        for task in TASKS
        if change.get("env.variant") not in _LACKS.get(task, ())
    }


ROWS = rows(Path("sets"), 1)
USUAL = ",".join(
    row_name(task, reward) for reward in (LEARNED, EVERYWHERE, SCORE) for task in TASKS
)


@dataclasses.dataclass(frozen=True)
class Settings(AuditedSettings):
    """Those of a suite."""

    eval_starts: int = 64
    """Starts of each variant that finished policies are evaluated from."""
    films: str | None = None
    """Folder with a folder of films for each task."""


def films_of(films: Path, task: str) -> Path:
    """The folder of a task's films; a DemoError that says how to get them if there are none."""
    for name in (folder_of(task), task):
        folder = films / name
        if any(next(folder.glob(kind), None) for kind in FILMS):
            return folder
    raise DemoError(f"{films} has no folder {folder_of(task)} with films of the task {task}; {HOW}")


def folder_of(task: str) -> str:
    """The name of the folder in which the publishers keep a task's films, such as find-dupe."""
    return _FOLDERS.get(task, task.replace("_", "-"))


def check_settings(config: RunConfig, settings: Settings) -> None:
    """Raises, before work starts, if films are missing or settings do not fit."""
    if config.run.algorithm != "ppo":
        raise ConfigError(f"run.algorithm is {config.run.algorithm!r}, but must be 'ppo' here")
    for change in settings.rows.values():
        made = Path(change["demos.path"]) / "demos.json"
        if made.is_file():
            continue
        if settings.films is None:
            raise DemoError(f"--films is missing, but must name a folder of films: {HOW}")
        films_of(Path(settings.films), change["env.name"])
