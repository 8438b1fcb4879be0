"""Replays the actions of MAGICAL's human demonstrations in our physics, as JSON.

    python -m gril_jax.experiments.fidelity.replay FOLDER --states replayed_states.npz
    python -m gril_jax.experiments.fidelity.replay recorded.json --tasks find_dupe fix_colour

FOLDER has the *.pkl.gz files of MatchRegions; the JSON file holds, by a name such as
"make-line/003", the `actions` of each demonstration of the other seven tasks. They are played open
loop from the Demo start; all ended with score 1 when recorded. Contacts amplify whatever differs,
so the replay is repeated from `--moved` starts in which the robot stands about 1e-5 units away:
`strayed` sets the distance of ours from the recordings beside that of ours from itself.

STATES holds for each demonstration of MatchRegions, under the last part of its file's name (`000`),
the poses (T + 1, 6, 3) of robot, star, square, blue pentagon, yellow circle and yellow pentagon.
Errors are distances to them in arena units, "blocks" those of blocks that have been moved by then.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from gril_jax.envs.magical.simulator import from_magical
from jaxtyping import Float, Int

from gril_jax import envs
from gril_jax.demos.magical_pickles import list_magical, read_actions
from gril_jax.errors import DemoError

from .physics_parity import arrays_of, figures_of, printed

TASKS = (
    "move_to_corner", "move_to_region", "find_dupe", "fix_colour", "cluster_colour",
    "cluster_shape", "make_line",
)  # fmt: skip
_AHEAD = (10, 20, 40, 120)  # control steps from the start over which errors are taken
_ASIDE = 1e-5  # arena units: standard deviation of a moved start
_MOVED = 0.01  # arena units: a block this far from its start has been moved

Actions = dict[str, Int[np.ndarray, "T"]]  # of each demonstration, by its name


@dataclass(frozen=True)
class _Options:
    recorded: Annotated[Path, tyro.conf.Positional]
    """A folder of MatchRegions' *.pkl.gz files, or a JSON file of the other tasks' actions."""
    tasks: tuple[str, ...] = TASKS
    """Tasks of a JSON file to replay."""
    states: Path | None = None
    """Recorded poses of MatchRegions to compare with, an .npz file."""
    engine: Literal["auto", "kernel", "impulse"] = "auto"
    """Solver that replays them."""
    substeps: int | None = None
    """Physics steps for each control step; None is the engine's default, 10."""
    iterations: int | None = None
    """Sweeps of the solver for each physics step; None is the engine's default, 6."""
    moved: int = 8
    """Number of further replays, from starts near the true one."""


def load(path: Path, tasks: tuple[str, ...]) -> dict[str, Actions]:
    """The actions of each task's demonstrations, of a JSON file; a folder of *.pkl.gz files has
    those of match_regions_magical alone. A DemoError names what is wrong in the file."""
    if path.is_dir():
        return {"match_regions_magical": _of_folder(path)}
    try:
        whole = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DemoError(f"{path} must be a JSON file of recorded actions ({error})") from error
    found = {}
    for task in tasks:
        if task not in TASKS:
            raise DemoError(f"{task!r} is no task to replay: these are {', '.join(TASKS)}")
        films = [name for name in sorted(whole) if name.partition("/")[0] == task.replace("_", "-")]
        if not films:
            raise DemoError(f"{path} has 0 demonstrations of {task}")
        named = {name: np.array(whole[name]["actions"], np.int32) for name in films}
        found[task] = _of_one_length(named, f"{path}: demonstrations of {task}")
    return found


def _of_folder(folder: Path) -> Actions:
    """Actions of MatchRegions' demonstrations: `000` of demo-...-v0-000.pkl.gz."""
    files = list_magical(folder)
    names = [file.name.removesuffix(".pkl.gz").rpartition("-")[2] for file in files]
    found = {name: read_actions(file) for name, file in zip(names, files, strict=True)}
    return _of_one_length(found, "demonstrations")


def _of_one_length(actions: Actions, what: str) -> Actions:
    if len({len(own) for own in actions.values()}) > 1:
        lengths = ", ".join(f"{name}: {len(own)}" for name, own in actions.items())
        raise DemoError(f"{what} differ in length ({lengths}), but must be equally long")
    return actions


def _poses(path: Path, actions: Actions) -> Float[np.ndarray, "D T1 6 3"]:
    arrays = arrays_of(path, "poses")
    for name, own in actions.items():
        if name not in arrays:
            raise DemoError(f"{path} has no poses of the demonstration {name}")
        found, shape = arrays[name].shape, (len(own) + 1, 6, 3)
        if found != shape:
            raise DemoError(f"{path}: {name} is {found}, but must be {shape}")
    return np.stack([arrays[name] for name in actions]).astype(np.float32)


def replay(env: envs.Env, actions: Float[np.ndarray, "D T 3"], aside: Float[np.ndarray, "K 2"]):
    """Positions (K, D, T, 6, 2) of robot and blocks, and final scores (K, D)."""
    parts = len(env.robot.parts)
    start = env.reset(jax.random.key(0))

    def move(state, action):
        state = env.step(state, action)
        place = jnp.concatenate([state.data.pose[:1], state.data.pose[parts:]])[:, :2]
        return state, (place, state.metrics["score"])

    def play(aside, actions):
        pose = start.data.pose.at[:parts, :2].add(aside)
        state = start._replace(data=start.data._replace(pose=pose))
        places, scores = jax.lax.scan(move, state, actions)[1]
        return places, scores[-1]

    over = jax.vmap(jax.vmap(play, (None, 0)), (0, None))
    places, scores = jax.jit(over)(jnp.asarray(aside, jnp.float32), jnp.asarray(actions))
    return np.asarray(places), np.asarray(scores)


def _errors(places: np.ndarray, recorded: np.ndarray) -> dict:
    """Errors of replays (D, T, 6, 2) against recorded poses, over the first steps."""
    theirs = recorded[:, 1:, :, :2]
    apart = np.linalg.norm(places - theirs, axis=-1)
    moved = np.linalg.norm(theirs - recorded[:, :1, :, :2], axis=-1) > _MOVED
    return {
        f"first_{n}": {
            "robot": figures_of(apart[:, :n, 0]),
            "blocks": figures_of(apart[:, :n, 1:][moved[:, :n, 1:]]),
        }
        for n in _AHEAD
        if n <= places.shape[1]
    }


def _strayed(places: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """Mean distance of all blocks (..., T, 1 + B, 2) from those of the reference, by step."""
    apart = np.linalg.norm(places - reference, axis=-1)[..., 1:]
    steps = [n for n in _AHEAD if n <= apart.shape[-2]]
    return {f"after_{n}": round(float(apart[..., n - 1, :].mean()), 5) for n in steps}


def measure(
    task: str,
    actions: Actions,
    recorded: Float[np.ndarray, "D T1 6 3"] | None = None,
    *,
    moved: int = 8,
    **options: Any,
) -> dict[str, Any]:
    """Scores of a task's replayed demonstrations, and their distance from recorded poses."""
    env = envs.make(task, physics="magical", **options)
    aside = np.random.default_rng(0).normal(scale=_ASIDE, size=(1 + moved, 2))
    aside[0] = 0.0
    places, scores = replay(env, from_magical(np.stack([*actions.values()])), aside)
    won = (scores > 0.999).sum(axis=1)
    result: dict[str, Any] = {
        "demonstrations": len(actions),
        "score_1": int(won[0]),
        "mean_score": round(float(scores[0].mean()), 4),
        "scores": {n: round(float(s), 4) for n, s in zip(actions, scores[0], strict=True)},
    }
    if moved:
        mean, strayed = round(float(scores[1:].mean()), 4), _strayed(places[1:], places[0])
        result["moved_starts"] = {"score_1": won[1:].tolist(), "mean_score": mean}
        result["moved_starts"]["strayed"] = strayed
    if recorded is not None:
        strayed = {"strayed": _strayed(places[0], recorded[:, 1:, :, :2])}
        result["errors"] = _errors(places[0], recorded) | strayed
    return result


def main(argv: list[str] | None = None) -> int:
    """Prints the figures of each task."""
    options = tyro.cli(_Options, args=argv)
    solver = {name: getattr(options, name) for name in ("engine", "substeps", "iterations")}

    def work() -> dict:
        if options.moved < 0:
            raise ValueError(f"moved is {options.moved}, but must be at least 0")
        if options.recorded.is_dir():
            each = {"match_regions": _of_folder(options.recorded)}
        else:
            each = load(options.recorded, options.tasks)
        figures = {}
        for task, actions in each.items():
            known = options.states is not None and task == "match_regions"
            poses = _poses(options.states, actions) if known else None
            figures[task] = measure(task, actions, poses, moved=options.moved, **solver)
        return {"options": solver, **figures}

    return printed("replay", work)


if __name__ == "__main__":
    sys.exit(main())
