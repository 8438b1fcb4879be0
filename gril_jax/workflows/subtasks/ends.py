"""Found ends of stages: scored against the true ones, and demonstrations cut at them, as a table,
as videos and as sets. Frames and seconds are those of the set's videos, and of the imported ones
where that is said."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from gril_jax.demos.demo import Demo
from gril_jax.demos.demo_set import DemoSet
from gril_jax.demos.files import write_demo_set
from gril_jax.demos.vision.video import write_video
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.safe_files import file_name
from gril_jax.subtasks.matching import match_within

_LEAST = 2  # frames of a demonstration
COLUMNS = (
    "video", "subtask", "first_frame", "last_frame", "begin_s", "end_s", "video_first_frame",
    "video_last_frame", "video_begin_s", "video_end_s", "found", "split", "doubt",
)  # fmt: skip


def scores(
    found: Sequence[Int[np.ndarray, "M"]], stages: Sequence[Mapping[str, int]], tolerance: int
) -> dict[str, Any]:
    """Scores of several demonstrations together.

    Found ends are increasing frames of each, filled up with -1; the true ones have names, and are
    -1 for never. A found one may miss a true one by `tolerance` frames.

    Returns:
      all_found: share of the demonstrations whose stages are all met.
      precision, recall: shares of the found and of the true ends that are met, of all together.
      median_error: median distance of those that are met, frames; NaN if there is none.
      errors: for each stage the median of found minus true, frames; None if never met.
      false: found ends that meet none, a demonstration.
      right_count: share of the demonstrations with as many ends as stages.
    """
    met, counts, truths = [], [], []
    errors: dict[str, list[int]] = {name: [] for name in stages[0]}
    for ends, times in zip(found, stages, strict=True):
        ends = ends[ends >= 0]
        order = sorted((time, name) for name, time in times.items() if time >= 0)
        true = jnp.array([time for time, _ in order], jnp.int32)
        # As many pairs as possible, and among those the nearest.
        column = np.asarray(_match(jnp.asarray(ends), true, tolerance=tolerance))
        for i in np.flatnonzero(column >= 0):
            time, name = order[column[i]]
            errors[name].append(int(ends[i]) - time)
        met.append((column >= 0).sum()), counts.append(len(ends)), truths.append(len(order))
    met, counts, truths = np.array(met), np.array(counts), np.array(truths)
    every = np.abs(np.array([e for one in errors.values() for e in one], float))
    return {
        "all_found": float(np.mean(met == truths)),
        "precision": float(met.sum() / max(counts.sum(), 1)),
        "recall": float(met.sum() / max(truths.sum(), 1)),
        "median_error": float(np.median(every)) if len(every) else float("nan"),
        "errors": {k: float(np.median(v)) if v else None for k, v in errors.items()},
        "false": float(np.mean(counts - met)),
        "right_count": float(np.mean(counts == truths)),
        "demonstrations": len(found),
    }


_match = jax.jit(match_within, static_argnames="tolerance")


def write_sets(
    out: Path,
    demo_set: DemoSet,
    shown: Sequence[Demo],
    ends: Int[np.ndarray, "B K"],
    progress: Progress,
) -> None:
    """A set in `out/subtask-1`, ... for each of the K subtasks, whose ends are last frames.

    A subtask's demonstration begins with the last frame of the stage before, where a policy of
    this subtask would begin, and ends with its own. The last subtask's goes on to the video's end,
    where the task is done for certain. Those of fewer than 2 frames are left out.
    """
    phase = progress.phase("cutting", total=ends.size, unit="videos", compiles=False)
    done = 0

    def demos(number: int) -> Iterator[Demo]:
        nonlocal done
        for demo, own in zip(shown, ends, strict=True):
            first, last = segments(own)[number]
            last = len(demo) - 1 if number == len(own) - 1 else last
            if last - first + 1 >= _LEAST:
                stages = demo.stages and {
                    name: frame - first if first <= frame <= last else -1
                    for name, frame in demo.stages.items()
                }
                cut = demo.during(slice(first, last + 1))
                yield replace(cut, trimmed=0, stages=stages)
            done += 1
            phase.update(done)

    for number in range(ends.shape[1]):
        write_demo_set(
            out / f"subtask-{number + 1}", demos(number),
            **(demo_set.about
               | {"source": f"subtask {number + 1} of {ends.shape[1]} of: {demo_set.source}"}),
        )  # fmt: skip


def segments(ends: Int[np.ndarray, "K"]) -> list[tuple[int, int]]:
    """First and last frame of each subtask, from the end of the one before to its own.

    >>> segments(np.array([4, 7]))
    [(0, 4), (4, 7)]
    """
    return list(zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True))


def of_video(demo: Demo, segment: tuple[int, int], fps: float) -> dict[str, Any]:
    """A segment in frames and seconds of the video that was imported, from its first frame."""
    first, last = segment
    if demo.source is None:  # a set that was not resampled
        frames, seconds = [first, last], [first / fps, last / fps]
    else:
        frames, seconds = (x[[first, last]].tolist() for x in demo.source)
    return {
        "first_frame": frames[0], "last_frame": frames[1],
        "begin_s": round(seconds[0], 3), "end_s": round(seconds[1], 3),
    }  # fmt: skip


def as_csv(demos: Mapping[str, Mapping[str, Any]], demo_set: DemoSet) -> str:
    """A line a segment; `demos` is what subtasks.json has under that name.

    `found` is 1 if the video itself shows the segment's end, 0 if it was put where the others have
    it. `doubt` has the reasons to doubt the video's stages.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for name, one in demos.items():
        rows = zip(one["segments"], one["video_segments"], one["found"], strict=True)
        for number, ((first, last), video, found) in enumerate(rows, 1):
            seconds = [round(frame / demo_set.fps, 3) for frame in (first, last)]
            about = int(found), one["split"], "; ".join(one["doubts"])
            table.writerow([_plain(name), number, first, last, *seconds, *video.values(), *about])
    return text.getvalue()


def write_videos(
    folder: Path, demos: Mapping[str, Mapping[str, Any]], demo_set: DemoSet, progress: Progress
) -> None:
    """Each segment as `NAME-1.mp4`, `NAME-2.mp4`, ... in a new folder."""
    phase = progress.phase("cutting", total=len(demos), unit="videos", compiles=False)
    with run_dir.writing(folder):
        folder.mkdir()
    for done, (name, one) in enumerate(demos.items(), 1):
        frames = demo_set[name].frames
        for number, (first, last) in enumerate(one["segments"], 1):
            file = folder / f"{file_name(name)}-{number}.mp4"
            write_video(file, frames[first : last + 1], demo_set.fps)
        phase.update(done)


def _plain(name: str) -> str:
    """A name that no spreadsheet takes for a formula."""
    return f"'{name}" if name[:1] in "=+-@" else name
