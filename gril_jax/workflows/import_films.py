"""Imports somebody's own films: the demonstration set, and a report to look at before learning.

gril demos import-videos FOLDER --boxes auto --robot hand --out mine

`import.txt` in the set says what was found in each film and what was mended, and `import.png` shows
pictures of each with the boxes as the set has them.
"""

import errno
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gril_jax.config import EnvConfig
from gril_jax.demos.demo_set import DemoSet, load_demo_set
from gril_jax.demos.own_films import Found, Import, import_films
from gril_jax.demos.tracking.detector import detecting
from gril_jax.demos.tracking.drawn import follower
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import ConfigError, DemoError
from gril_jax.export import lerobot
from gril_jax.report.figures.filmstrip import Film, contact_sheet
from gril_jax.report.figures.style import png
from gril_jax.runs.progress import Progress
from gril_jax.safe_files import write_whole, writing
from gril_jax.workflows.build import setup, vocabulary

_OF_THE_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.EACCES)
_SHOWN = 12  # films on the contact sheet, at most
_MANY = 0.3  # share of the boxes that may be missing before it is worth a sentence


def main(
    source: Path,
    out: Path,
    *,
    task: str | None = None,
    robots: Sequence[str] = (),
    camera: str | None = None,
    track: Path | None = None,
    detector: str | None = None,
    echo: Callable[[str], None] = print,
    **options: Any,
) -> Import:
    """Makes the set; `options` are those of `import_films`. Returns what was found.

    Boxes are those beside the films, or with `track` those drawn on their first frames, or with
    `detector` what that function says. The films of a LeRobot dataset are those of a camera.
    """
    if task is not None:
        env = setup.make_env(EnvConfig(name=task), training=False)
        options |= {"task": task, "classes": env.classes}
        robots = robots or vocabulary.of_task(env, task).robots
    with Progress() as progress:
        phase = progress.phase("reading", total=0, unit="films", compiles=False)

        def tell(done: int, total: int, last: Found) -> None:
            phase.total = total
            phase.update(done)

        try:
            if lerobot.is_dataset(source):
                dataset = lerobot.opened(source)
                options["films"] = lerobot.films(dataset, lerobot.camera_of(dataset, camera))
                options["boxes"] = lerobot.boxes_in(dataset)
            elif camera is not None:
                raise ConfigError(f"--camera is {camera}, but {source} is no LeRobot dataset")
            if track is not None or detector is not None:
                options["boxes"] = follower(track) if track is not None else detecting(detector)
            found = import_films(source, out, robots=robots, progress=tell, **options)
        except DemoError as error:
            if getattr(error.__cause__, "errno", None) in _OF_THE_DISK:
                raise
            raise ConfigError(str(error)) from None  # what is given is wrong, not the work
    lines = in_words(found, robots)
    demo_set = load_demo_set(out)
    with writing(out):
        write_whole(out / "import.txt", "\n".join([*lines, *map(_line, found.films)]) + "\n")
        write_whole(out / "import.png", png(sheet(demo_set)))
    for line in lines:
        echo(line)
    echo(f"look at {out / 'import.png'}; each film is in {out / 'import.txt'}")
    echo(f"wrote {out}")
    return found


def in_words(found: Import, robots: Sequence[str]) -> list[str]:
    """Sentences on the films together."""
    films = found.films
    classes = dict.fromkeys(name for film in films for name in film.objects)
    most = {name: max(film.objects[name] for film in films) for name in classes}
    shown = ", ".join(f"{n} x {name}" if n > 1 else name for name, n in most.items())
    acting = f"of these the robot or person is {', '.join(robots)}" if robots else "none acts"
    jitter = max(film.jitter for film in films)
    lines = [
        f"{len(films)} films, {found.fps:g} frames a second; objects: {shown}; {acting}",
        f"lengths are in {found.unit}; a frame shows {found.half_extent:g} to each side of its "
        "middle",
        _mended(films),
    ]
    if jitter:
        lines.append(
            f"boxes jitter by {jitter:.1f} pixels: this is in the set as noise {found.noise:.4f} "
            f"({found.unit}), so that resting objects do not count as moved (--jitter sets it)"
        )
    if several := [name for name, n in most.items() if n > 1]:
        lines.append(
            f"there are several of {', '.join(several)}: in each film {several[0]} 1 is the first "
            "that moves, and those that stay where they are follow from left to right"
        )
    if not robots:
        lines.append("no class is the robot's or the person's: name it with --robot if one is")
    lines += [f"doubtful: {doubt}" for film in films for doubt in _doubts(film)]
    return lines


def _mended(films: Sequence[Found]) -> str:
    """A sentence on what was missing or wrong in the boxes of all films."""
    missing = np.mean([film.missing for film in films])
    carried, stray, renewed = (
        sum(getattr(film, name) for film in films) for name in ("carried", "stray", "renewed")
    )
    said = [f"{missing:.0%} of the boxes are missing and were filled in"]
    if carried:
        said.append(f"{carried} times something was carried out of sight, and goes with the hand")
    if stray:
        said.append(f"{stray} were of another object and left out")
    if renewed:
        said.append(f"{renewed} changes of a tracker's identity were followed")
    return "; ".join(said)


def _doubts(film: Found) -> list[str]:
    lacks = [name for name, count in film.objects.items() if not count]
    said = [f"{film.name} never shows {', '.join(lacks)}"] if lacks else []
    if film.missing > _MANY:
        said.append(f"{film.name} lacks {film.missing:.0%} of its boxes")
    return said


def _line(film: Found) -> str:
    objects = ", ".join(f"{count} x {name}" for name, count in film.objects.items())
    return (
        f"{film.name}: {film.frames} frames kept and {film.trimmed} cut from its resting end; "
        f"{objects}; {film.missing:.1%} of the boxes missing, all objects seen from "
        f"{film.late:.1f} s; {film.carried} times carried out of sight; {film.stray} stray, "
        f"{film.extra} second and {film.outside} outside boxes left out; {film.renewed} "
        f"identities renewed; jitter {film.jitter:.2f} pixels, "
        f"smoothed over {film.smoothing} frames"
    )


def sheet(demo_set: DemoSet):
    """Four pictures of each film with the boxes of the set."""
    pairs = zip(demo_set.entries, demo_set.tracks, strict=True)
    films = []
    for entry, tracks in list(pairs)[:_SHOWN]:
        shown = np.flatnonzero(tracks.seen.any(axis=0))
        frames, own = read_video(demo_set.folder / entry.video), tracks.of(shown)
        thick = np.ones(own.seen.shape, bool)
        films.append(Film(entry.name, frames, own, thick))
    return contact_sheet(films, demo_set.classes, demo_set.half_extent)
