"""Replays the actions of MAGICAL's human demonstrations of its other seven tasks, as JSON.

    python -m gril_jax.experiments.fidelity.suite_replay recorded.json      # a minute on 2 cores
    python -m gril_jax.experiments.fidelity.suite_replay recorded.json --tasks find_dupe fix_colour

The file holds, by a name such as "make-line/003", the final `score` and the `actions` of each: the
original's numbers from 0 to 17. They are played open loop from the Demo start, and repeated from
`--moved` starts in which the robot stands about 1e-5 units away: contacts amplify whatever differs.
All ended with score 1 when recorded. In the original's own engine those of the four short tasks
still do, of the long ones 2 to 6 of 25.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro
from gril_jax.envs.magical.simulator import from_magical
from jaxtyping import Int

from gril_jax import envs
from gril_jax.errors import DemoError

from .magical_replay import ASIDE, replay
from .physics_parity import printed

TASKS = (
    "move_to_corner", "move_to_region", "find_dupe", "fix_colour", "cluster_colour",
    "cluster_shape", "make_line",
)  # fmt: skip
_FULL = 0.999  # a score of 1


@dataclass(frozen=True)
class _Options:
    recorded: Annotated[Path, tyro.conf.Positional]
    """The recorded actions, a JSON file."""
    tasks: tuple[str, ...] = TASKS
    """Tasks to replay."""
    engine: Literal["auto", "kernel", "impulse"] = "auto"
    """Solver that replays them."""
    iterations: int | None = None
    """Sweeps of the solver for each physics step; None is the engine's default, 6."""
    moved: int = 8
    """Number of further replays, from starts near the true one."""


def load(path: Path, tasks: tuple[str, ...]) -> dict[str, Int[np.ndarray, "D T"]]:
    """The actions of each task's demonstrations; a DemoError names what is wrong in the file."""
    try:
        whole = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DemoError(f"{path} must be a JSON file of recorded actions ({error})") from error
    found = {}
    for task in tasks:
        if task not in TASKS:
            raise DemoError(f"{task!r} is no task to replay: these are {', '.join(TASKS)}")
        films = [name for name in whole if name.partition("/")[0] == task.replace("_", "-")]
        lengths = {len(whole[name]["actions"]) for name in films}
        if len(lengths) != 1:
            raise DemoError(f"{path} has {len(films)} demonstrations of {task} of {lengths} steps")
        found[task] = np.array([whole[name]["actions"] for name in sorted(films)], np.int32)
    return found


def measure(
    task: str, actions: Int[np.ndarray, "D T"], *, moved: int = 8, **options
) -> dict[str, object]:
    """Final scores of a task's replayed demonstrations, from the Demo start and from near it."""
    env = envs.make(task, physics="magical", **options)
    aside = np.random.default_rng(0).normal(scale=ASIDE, size=(1 + moved, 2))
    aside[0] = 0.0
    _, scores = replay(env, from_magical(actions), aside)
    won = (scores > _FULL).sum(axis=1)
    found = {
        "demonstrations": len(actions),
        "score_1": int(won[0]),
        "mean_score": round(float(scores[0].mean()), 3),
        "scores": [round(float(s), 3) for s in scores[0]],
    }
    if moved:
        mean = round(float(scores[1:].mean()), 3)
        found["moved_starts"] = {"score_1": won[1:].tolist(), "mean_score": mean}
    return found


def main(argv: list[str] | None = None) -> int:
    """Prints the figures of each task."""
    options = tyro.cli(_Options, args=argv)
    solver = {"engine": options.engine, "iterations": options.iterations}

    def work() -> dict:
        if options.moved < 0:
            raise ValueError(f"moved is {options.moved}, but must be at least 0")
        actions = load(options.recorded, options.tasks)
        each = {t: measure(t, a, moved=options.moved, **solver) for t, a in actions.items()}
        return {"options": solver, **each}

    return printed("suite_replay", work)


if __name__ == "__main__":
    sys.exit(main())
