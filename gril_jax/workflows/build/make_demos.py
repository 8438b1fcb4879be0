"""Scripted demonstrations: a task's expert acts, its episodes are recorded, and boxes are read.

    gril demos make quickstart --out DEMOS        about half a minute on two CPU cores

Nothing but the videos reaches the demonstration set: boxes come from their frames.
"""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

from gril_jax import envs
from gril_jax.config import MakeDemosConfig, RunConfig
from gril_jax.demos.demo import Demo, Tracks
from gril_jax.demos.demo_set import DemoSet, load_demo_set
from gril_jax.demos.detected import by_colour
from gril_jax.demos.files import write_demo_set
from gril_jax.demos.importing import import_videos
from gril_jax.demos.vision import video
from gril_jax.envs.base import Demonstrations, Env, Episode, ExpertError, Film, Wanted
from gril_jax.envs.user_tasks import episodes as own_episodes
from gril_jax.envs.user_tasks import protocol
from gril_jax.errors import DemoError
from gril_jax.runs.progress import Progress
from gril_jax.threads import parallel_map

from . import filming, setup

_AFTER = 5  # frames that a video goes on once the task is done
_ROUNDS = 4  # times as many episodes are played as are wanted, before giving up


def main(
    config: MakeDemosConfig,
    out: Path,
    echo: Callable[[str], None] = print,
    *,
    variant: str | None = None,
    seed: int = 0,
) -> None:
    """Writes a demonstration set to `out`; see `make`."""
    with Progress() as progress:
        made = make(config, out, progress, variant=variant, seed=seed)
    trimmed, frames = sum(demo.trimmed for demo in made), sum(map(len, made))
    echo(f"wrote {len(made)} demonstrations of {frames} frames to {out} ({trimmed} trimmed)")


def make(
    config: MakeDemosConfig | RunConfig,
    out: Path,
    progress: Progress,
    *,
    variant: str | None = None,
    seed: int = 0,
) -> DemoSet:
    """Plays the task's expert, videos it, and saves what a detector reads as a set at `out`.

    Episodes begin in a variant; None is the task's own if that is "jitter", else "layout": then
    they differ more than the task's, and the reward holds for all of these. A task of a user's own
    begins as it does without a variant.

    Raises DemoError if the expert fails too often, or lacks something that it needs.
    """
    chosen, name, own = config.demos, config.env.name, config.env.is_own
    if own and variant is not None and "variant" not in envs.options(name):
        raise DemoError(
            f"the variant is {variant}, but {config.env.shown_name} takes no option variant"
        )
    among = {"variant": variant} if own and variant is not None else {}
    variant = variant or ("jitter" if config.env.variant == "jitter" else "layout")
    good, bad = chosen.num + chosen.num_validation, chosen.num_failures
    wanted = envs.Wanted(good, bad, seed, variant)
    phase = progress.phase("playing the expert", total=good + bad, unit="episodes")

    def build(**changes) -> envs.Env:
        given = setup.task_options(config.env, training=False)
        return setup.build(name, given | among | changes)

    try:
        if own:
            shown = played_by_own_expert(build, wanted, phase.update)
        elif not envs.spec(name).demonstrate:
            raise envs.ExpertError(
                f"the task {name} has no scripted expert: gril demos import-videos reads videos"
            )
        else:
            shown = envs.demonstrate(name)(build, wanted, phase.update)
        where = "" if own and not among else f" {variant} layout,"
        source = f"scripted expert,{where} seed {seed}"
        save = _save_videos if shown.films is None else _save_films
        return save(shown, out, progress, task=config.env.shown_name, source=source)
    except envs.ExpertError as error:
        raise DemoError(str(error)) from error


def _save_videos(
    shown: envs.Demonstrations, out: Path, progress: Progress, **header: str
) -> DemoSet:
    """Videos the episodes by their outlines, and reads the videos by colour."""
    env, episodes = shown.env, shown.episodes
    stems = [f"{number:03d}_{episode.outcome}" for number, episode in enumerate(episodes)]
    with tempfile.TemporaryDirectory() as scratch:
        phase = progress.phase("recording", total=len(episodes), unit="videos", compiles=False)

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

        def tell(done: int, _: int) -> None:
            phase.update(done)

        return import_videos(
            scratch, out, boxes=boxes, outcome=outcome, progress=tell,
            writing=progress.steps("writing", "videos"), **header,
        )  # fmt: skip


def _save_films(
    shown: envs.Demonstrations, out: Path, progress: Progress, **header: str
) -> DemoSet:
    """Saves videos whose boxes the task's own detector has read."""
    env, episodes = shown.env, shown.episodes
    phase = progress.phase("recording", total=len(episodes), unit="videos", compiles=False)
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


def played_by_own_expert(
    make: Callable[..., Env], wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """Episodes of the expert of a user's own task, `expert(state, key) -> action`, with the task's
    own boxes and drawings.

    It plays until there are enough successes; failures are those that came along. An episode ends a
    few frames after its success; what ends without one is a failure.
    """
    env = make()
    if env.expert is None:
        raise ExpertError("the task has no `expert`, a function (state, key) -> action")
    episodes, good, bad = jax.jit(own_episodes.play(env, env.expert)), [], []
    key, each = jax.random.key(wanted.seed), wanted.successes + wanted.failures
    for turn in range(_ROUNDS):
        states = jax.device_get(episodes(jax.random.split(jax.random.fold_in(key, turn), each)))
        if (wrong := protocol.not_finite(states)) is not None:
            raise ExpertError(f"the expert's episodes have NaN or infinity in {wrong}")
        for number in range(each):
            one = jax.tree.map(lambda x, n=number: x[:, n], states)
            ended = _end(one)
            (bad if ended is None else good).append(_cut(one, ended))
        tell(min(len(good), wanted.successes) + min(len(bad), wanted.failures))
        if len(good) >= wanted.successes:
            break
    else:
        raise ExpertError(
            f"the expert ended {len(good)} of {_ROUNDS * each} episodes with success, but "
            f"{wanted.successes} are wanted"
        )
    shown = good[: wanted.successes] + bad[: wanted.failures]
    kinds = ["success"] * wanted.successes + ["failure"] * (len(shown) - wanted.successes)
    objects = jax.tree.map(lambda x: x[0], shown[0].objects)
    for name in ("label", "is_robot"):
        if any((getattr(one.objects, name)[0] != getattr(objects, name)).any() for one in shown):
            raise ExpertError(
                f"{name} differs between the task's episodes, but a set's objects have one order: "
                "give each class its own place in objects"
            )
    names = tuple(env.classes[i] for i in objects.label)
    robots = tuple(sorted({names[i] for i in np.flatnonzero(objects.is_robot)}))
    played = [Episode(kind, kind, one.data) for kind, one in zip(kinds, shown, strict=True)]
    return Demonstrations(env, names, played, _films(env, shown), robots)


def _end(states: Any) -> int | None:
    """The first frame from which the task stays done; None if it is not done at the end."""
    done = states.metrics["success"] > 0.5
    if (ended := states.done[1:] > 0.5).any():  # what follows belongs to no episode
        done = done[: int(np.argmax(ended)) + 2]
    if not done[-1] or done[0]:
        return None
    return len(done) - int(np.argmin(done[::-1]))


def _cut(states: Any, end: int | None) -> Any:
    """The frames of an episode that are shown."""
    last = len(states.done) if end is None else min(end + 1 + _AFTER, len(states.done))
    ended = np.flatnonzero(states.done > 0.5)
    last = min([last, *(ended[:1] + 1)])
    return jax.tree.map(lambda x: x[:last], states)


def _films(env: Env, episodes: list[Any]) -> Iterator[Film]:
    for states in episodes:
        seen = states.objects
        shown = np.ones(seen.center.shape[:2], bool)
        yield Film(filming.outlines(env, states.data), seen.center, seen.size, shown)
