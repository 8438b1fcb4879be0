"""Segments of films as a table and as films of their own.

Frames and seconds are those of the demonstration set's films, from their first frame.
"""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gril_jax.demos.demo_set import DemoSet
from gril_jax.demos.vision.video import write_video
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress

COLUMNS = ("film", "subtask", "first_frame", "last_frame", "begin_s", "end_s", "found", "split")


def as_csv(demos: Mapping[str, Mapping[str, Any]], demo_set: DemoSet) -> str:
    """A line a segment; `demos` is what subtasks.json has under that name.

    `found` is 1 if the film itself shows the segment's end, 0 if it was put where the others have
    it.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for name, one in demos.items():
        pairs = zip(one["segments"], one["found"], strict=True)
        for number, ((first, last), found) in enumerate(pairs, 1):
            seconds = [round(frame / demo_set.fps, 3) for frame in (first, last)]
            table.writerow([_plain(name), number, first, last, *seconds, int(found), one["split"]])
    return text.getvalue()


def write_films(
    folder: Path, demos: Mapping[str, Mapping[str, Any]], demo_set: DemoSet, progress: Progress
) -> None:
    """Each segment as `NAME-1.mp4`, `NAME-2.mp4`, ... in a new folder."""
    phase = progress.phase("cutting", total=len(demos), unit="films", compiles=False)
    with run_dir.writing(folder):
        folder.mkdir()
    for done, (name, one) in enumerate(demos.items(), 1):
        frames = demo_set[name].frames
        for number, (first, last) in enumerate(one["segments"], 1):
            file = folder / f"{name.replace('/', '_')}-{number}.mp4"
            write_video(file, frames[first : last + 1], demo_set.fps)
        phase.update(done)


def _plain(name: str) -> str:
    """A name that no spreadsheet takes for a formula."""
    return f"'{name}" if name[:1] in "=+-@" else name
