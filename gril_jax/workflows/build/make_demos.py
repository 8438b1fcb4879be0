"""Scripted demonstrations: a task's expert acts, its episodes are filmed, and boxes are read.

    gril demos make quickstart --out DEMOS        about half a minute on two CPU cores

Nothing but the films reaches the demonstration set: boxes come from their frames.
"""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from gril_jax import envs
from gril_jax.config import MakeDemosConfig, RunConfig
from gril_jax.config.task import Places
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.demo_set import DemoSet, load_demo_set
from gril_jax.demos.detected import by_colour
from gril_jax.demos.importing import import_videos
from gril_jax.demos.vision import video
from gril_jax.demos.writer import write_demo_set
from gril_jax.errors import DemoError
from gril_jax.runs.progress import Progress
from gril_jax.threads import parallel_map

from . import filming, own_expert, setup


def main(
    config: MakeDemosConfig,
    out: Path,
    echo: Callable[[str], None] = print,
    *,
    variant: Places = "layout",
    seed: int = 0,
) -> None:
    """Writes a demonstration set to `out`; its starts are those of a variant."""
    with Progress() as progress:
        made = make(config, out, progress, variant=variant, seed=seed)
    trimmed, frames = sum(demo.trimmed for demo in made), sum(map(len, made))
    echo(f"wrote {len(made)} demonstrations of {frames} frames to {out} ({trimmed} trimmed)")


def make(
    config: MakeDemosConfig | RunConfig,
    out: Path,
    progress: Progress,
    *,
    variant: Places = "layout",
    seed: int = 0,
) -> DemoSet:
    """Plays the task's expert, films it, and saves what a detector reads as a set at `out`.

    Raises DemoError if the expert fails too often, or lacks something that it needs.
    """
    chosen, name = config.demos, config.env.name
    good, bad = chosen.num + chosen.num_validation, chosen.num_failures
    wanted = envs.Wanted(good, bad, seed, variant)
    phase = progress.phase("playing the expert", total=good + bad, unit="episodes")

    def build(**changes) -> envs.Env:
        return setup.build(name, setup.task_options(config.env, training=False) | changes)

    try:
        if config.env.is_own:
            shown = own_expert.demonstrate(build, wanted, phase.update)
        elif not envs.spec(name).demonstrate:
            raise envs.ExpertError(
                f"the task {name} has no scripted expert: gril demos import-videos reads films"
            )
        else:
            shown = envs.demonstrate(name)(build, wanted, phase.update)
        source = f"scripted expert, {variant} layout, seed {seed}"
        save = _save_videos if shown.films is None else _save_films
        return save(shown, out, progress, task=config.env.shown_name, source=source)
    except envs.ExpertError as error:
        raise DemoError(str(error)) from error


def _save_videos(
    shown: envs.Demonstrations, out: Path, progress: Progress, **header: str
) -> DemoSet:
    """Films the episodes by their outlines, and reads the videos by colour."""
    env, episodes = shown.env, shown.episodes
    stems = [f"{number:03d}_{episode.outcome}" for number, episode in enumerate(episodes)]
    with tempfile.TemporaryDirectory() as scratch:
        phase = progress.phase("filming", total=len(episodes), unit="videos", compiles=False)

        def shoot(number: int) -> None:
            frames = filming.outlines(env, episodes[number].data)
            video.write_video(Path(scratch) / f"{stems[number]}.mp4", frames, env.control_hz)

        for done, _ in enumerate(parallel_map(shoot, range(len(episodes))), 1):
            phase.update(done)
        phase = progress.phase("detecting", total=len(episodes), unit="videos", compiles=False)
        outcome = {stem: one.outcome for stem, one in zip(stems, episodes, strict=True)}
        boxes = by_colour(
            header["task"], env.half_extent, classes=env.classes, objects=shown.objects
        )

        def tell(done: int, total: int) -> None:
            phase.total = total
            phase.update(done)

        return import_videos(scratch, out, boxes=boxes, outcome=outcome, progress=tell, **header)


def _save_films(
    shown: envs.Demonstrations, out: Path, progress: Progress, **header: str
) -> DemoSet:
    """Saves films whose boxes the task's own detector has read."""
    env, episodes = shown.env, shown.episodes
    phase = progress.phase("filming", total=len(episodes), unit="videos", compiles=False)
    label = np.array([env.classes.index(name) for name in shown.objects], np.int32)

    def demos() -> Iterator[Demo]:
        for number, (episode, film) in enumerate(zip(episodes, shown.films, strict=True)):
            name = f"{number:03d}_{episode.kind.replace(' ', '_')}"
            tracks = Tracks(film.center, film.size, label, film.seen)
            yield Demo(name, film.frames, tracks, 0, episode.outcome, episode.stages)
            phase.update(number + 1)

    write_demo_set(
        out, demos(), classes=env.classes, half_extent=env.half_extent, fps=env.control_hz,
        robots=shown.robots, **header,
    )  # fmt: skip
    return load_demo_set(out)
