"""Measures the scripted experts of the tasks on the table, as JSON.

    python -m gril_jax.experiments.tabletop.experts                  # two minutes on 2 cores
    python -m gril_jax.experiments.tabletop.experts --tasks umbrella_out --starts 300 --failures 10

For each task: from how many random starts its expert succeeds, its median length, how many of its
failures are what their names say, and how stages as seen in a picture agree with the true ones.
Stages are read from boxes of whole things, as audits of rewards do; with `--sets`, a folder of
demonstration sets by the tasks' names, also from the boxes of the detector in their successes. A
film agrees if each of its stages is seen for good within `NEAR` frames of when it first truly held.
"""

import functools
import pkgutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import numpy as np
import tyro
from gril_jax.envs.checks import check_counts
from gril_jax.envs.stages import Stages
from gril_jax.envs.tabletop.entry import Entry
from gril_jax.experiments.fidelity.physics_parity import printed

from gril_jax.demos.demo_set import load_demo_set

TASKS = (
    "shoes_in_box", "rubbish_in_bin", "umbrella_out", "item_in_drawer", "shoes_out_of_box",
    "empty_container",
)  # fmt: skip
NEAR = 20  # frames: a second
_SAME = 1024  # frames: lengths of films are made up to a multiple


@dataclass(frozen=True)
class _Options:
    tasks: tuple[str, ...] = TASKS
    """Tasks to measure."""
    starts: int = 300
    """Random starts from which each expert plays."""
    failures: int = 10
    """Episodes of each kind of failure."""
    seed: int = 0
    """Seed of starts and styles."""
    sets: Path | None = None
    """Folder of demonstration sets, each named after its task; a task without one has none."""


def seen_for_good(stages: Stages, center: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The frames from which on each stage is seen until the end; -1 where it is not at the end.

    Boxes are those of T frames, (T, N, 2); stages count by themselves, in any order.
    """
    rows = np.minimum(np.arange(-len(center) % _SAME + len(center)), len(center) - 1)
    found = _held(stages)(center[rows], size[rows])  # of few lengths, as each is compiled
    held = np.stack(jax.device_get(found), axis=1)[: len(center)]
    last_missing = len(held) - 1 - held[::-1].argmin(axis=0)
    times = np.where(held.all(axis=0), 0, last_missing + 1)
    return np.where(held[-1], times, -1)


@functools.lru_cache(maxsize=8)
def _held(stages: Stages) -> Callable:
    return jax.jit(jax.vmap(lambda c, s: [stage.holds(c, s) for stage in stages.stages]))


def agreement(stages: Stages, films: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict:
    """How stages as seen agree with true ones in films: (centre, size, true frame of each)."""
    gaps, found = [], []
    for center, size, true in films:
        seen = seen_for_good(stages, center, size)
        gap = np.where(seen < 0, np.inf, np.abs(seen - true))
        gaps.append(gap)
        found.append(bool((gap <= NEAR).all()))
    return {
        "films": len(films),
        "agree": round(float(np.mean(found)), 4),
        "median_frames_off": [float(x) for x in np.median(gaps, axis=0)],
    }


def measure(name: str, *, starts: int, failures: int, seed: int, sets: Path | None) -> dict:
    """The figures of one task."""
    entry: Entry = pkgutil.resolve_name(f"gril_jax.envs.tabletop.{name}.task:ENTRY")
    env, script = entry.make(), entry.script
    drawn = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(seed), starts))
    drawn = jax.device_get(drawn)

    def play(number: int, kind: str):
        start = jax.tree.map(lambda x: x[number], drawn)
        return script.play(env, start, (seed, number), kind)

    play(0, "success")  # compiles
    begin = time.perf_counter()
    runs = [play(number, "success") for number in range(starts)]
    seconds = (time.perf_counter() - begin) / starts
    good = [run for run in runs if script.as_meant(run)]
    meant = {
        kind: sum(script.as_meant(play(i, kind)) for i in range(min(failures, starts)))
        for kind in script.kinds[1:]
    }
    found = {
        "starts": starts,
        "unplaced": int(drawn.data.unplaced.sum()),
        "succeeded": len(good),
        "median_frames": float(np.median([len(run.qpos) for run in good])),
        "seconds_an_episode": round(seconds, 3),
        "failures_as_meant": {"of": min(failures, starts), **meant},
        "stages_by_whole_boxes": agreement(
            env.stages, [(r.center, r.size, r.stage_time) for r in good]
        ),
    }
    if sets is not None and (sets / name).is_dir():
        found["stages_by_detected_boxes"] = agreement(
            env.stages, _films(sets / name, env.stage_names)
        )
    return found


def _films(folder: Path, names: tuple[str, ...]) -> list[tuple]:
    """Boxes and true frames of a set's successes."""
    shown = load_demo_set(folder)
    return [
        (tracks.center, tracks.size, np.array([entry.stages[name] for name in names]))
        for entry, tracks in zip(shown.entries, shown.tracks, strict=True)
        if entry.outcome == "success"
    ]


def main(argv: list[str] | None = None) -> int:
    """Prints the figures of each task."""
    options = tyro.cli(_Options, args=argv)

    def work() -> dict:
        check_counts(starts=options.starts, failures=options.failures)
        unknown = sorted({*options.tasks} - {*TASKS})
        if unknown:
            raise ValueError(f"{unknown[0]!r} is no task here: these are {', '.join(TASKS)}")
        told = partial(
            measure, starts=options.starts, failures=options.failures, seed=options.seed,
            sets=options.sets,
        )  # fmt: skip
        return {"seed": options.seed, "near_frames": NEAR} | {t: told(t) for t in options.tasks}

    return printed("experts", work)


if __name__ == "__main__":
    sys.exit(main())
