"""Demonstrations cut at the ends of their stages: a set for each subtask."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int

from gril_jax.demos.demo_set import Demo, DemoSet, save_demo_set
from gril_jax.demos.schema import DemoEntry
from gril_jax.demos.vision.video import read_video
from gril_jax.runs.progress import Progress

_LEAST = 2  # frames of a demonstration


def write_sets(
    out: Path,
    demo_set: DemoSet,
    entries: Sequence[DemoEntry],
    ends: Int[np.ndarray, "B K"],
    progress: Progress,
) -> None:
    """A set in `out/subtask-1`, ... for each of the K subtasks.

    A subtask's demonstration begins with the last frame of the stage before, where a policy of
    this subtask would begin, and ends with its own; the last subtask's goes on to the film's end,
    where the task is done for certain. Those of fewer than 2 frames are left out; DemoError if
    nothing is left. The ends are the last frames of each entry's stages.
    """
    phase = progress.phase("cutting", total=ends.size, unit="films", compiles=False)
    tracks = {e.name: t for e, t in zip(demo_set.entries, demo_set.tracks, strict=True)}
    done = 0

    def demos(number: int) -> Iterator[Demo]:
        nonlocal done
        for entry, own in zip(entries, ends, strict=True):
            first, last = segments(own, entry.frames)[number]
            if last - first + 1 >= _LEAST:
                span = slice(first, last + 1)
                frames = read_video(demo_set.folder / entry.video)[span]
                stages = entry.stages and {
                    name: frame - first if first <= frame < first + len(frames) else -1
                    for name, frame in entry.stages.items()
                }
                during = tracks[entry.name].during(span)
                yield Demo(entry.name, frames, during, 0, entry.outcome, stages)
            done += 1
            phase.update(done)

    for number in range(ends.shape[1]):
        save_demo_set(
            out / f"subtask-{number + 1}", demos(number), task=demo_set.task,
            classes=demo_set.classes, half_extent=demo_set.half_extent, fps=demo_set.fps,
            source=f"subtask {number + 1} of {ends.shape[1]} of: {demo_set.source}",
        )  # fmt: skip


def segments(ends: Int[np.ndarray, "K"], num_frames: int) -> list[tuple[int, int]]:
    """First and last frame of each subtask, see `write_sets`.

    >>> segments(np.array([4, 7]), 10)
    [(0, 4), (4, 9)]
    """
    firsts = [0, *ends[:-1].tolist()]
    return list(zip(firsts, [*firsts[1:], num_frames - 1], strict=True))
