"""The folder with the results of `gril subtasks`, which a later call may refine."""

import contextlib
import glob
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gril_jax.errors import RunError
from gril_jax.runs import run_dir
from gril_jax.safe_files import file_name, read_object


@contextlib.contextmanager
def part_of(out: Path) -> Iterator[Path]:
    """A hidden folder beside the results, which is removed at the end."""
    out.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    part.chmod(0o755)
    try:
        yield part
    finally:
        shutil.rmtree(part, ignore_errors=True)


def settle(part: Path, out: Path, segments_now: Mapping[str, Any]) -> None:
    """Moves new results into place, over those of an earlier call, of which what is not made
    again stays if its segments are the same.

    Raises RunError if sets or a LeRobot copy of other segments are there: others may use them.
    """
    before, names = _earlier(out)
    same = before == segments_now
    kept = sorted([*out.glob("subtask-*"), *out.glob("lerobot")])
    if kept and not same:
        raise RunError(
            f"{kept[0]} is of other segments than those that are found now, so it is left alone: "
            "name a new folder with --out"
        )
    with run_dir.writing(out):
        out.mkdir(parents=True, exist_ok=True)
        if not same:
            for name in names:
                (out / f"{name}.png").unlink(missing_ok=True)
                for file in (out / "videos").glob(f"{glob.escape(name)}-*.mp4"):
                    file.unlink()
        for new in sorted(part.iterdir()):
            old = out / new.name
            if old.is_dir():
                shutil.rmtree(old)
            os.replace(new, old)


def _earlier(out: Path) -> tuple[dict[str, Any], list[str]]:
    """The segments and the names of files that an earlier call wrote; empty without one."""
    try:
        demos = read_object(out / "subtasks.json")["demonstrations"]
        segments = {name: [[*map(int, s)] for s in one["segments"]] for name, one in demos.items()}
    except (FileNotFoundError, RunError, LookupError, TypeError, AttributeError, ValueError):
        return {}, []
    return segments, [*map(file_name, segments)]
