"""The registry's entry of a table task: its constructor, and its scripted expert, recorded.

Each control step is a frame. A detector reads which thing each pixel shows, so that it sees no more
than a camera: a thing that is partly hidden has a smaller box, one that is wholly hidden keeps its
last. Shapes use T for frames, N for things and P for a picture's pixels along one side.
"""

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from gril_jax.envs.base import Demonstrations, Episode, ExpertError, Film, State, Wanted
from jaxtyping import Bool, Float32, Int8

from .environment import Tabletop
from .recorded import Run, Script, moments
from .render import Renderer
from .start import Moments
from .task import Task

JITTER = {"demo": 0.0, "jitter": 0.5, "layout": 1.0}  # of starts, by `Wanted.places`
_BATCH = 32  # starts sampled at once
_PATIENCE = 4  # episodes played for each that is wanted, at most
_PIXELS = 256


class Sightings(NamedTuple):
    """Detected boxes of N objects, of one frame or of T."""

    center: Float32[np.ndarray, "*T N 2"]  # middles
    size: Float32[np.ndarray, "*T N 2"]  # widths and heights; above 0 where seen
    seen: Bool[np.ndarray, "*T N"]


def record(
    env: Tabletop, script: Script, wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """The demonstrations wanted; the jitter of their starts is the environment's.

    Raises:
      ExpertError: there is no OpenGL, a thing is never seen, or the expert fails too often.
    """
    try:
        renderer = Renderer(env, next(_starts(env, wanted.seed)), pixels=_PIXELS)
    except RuntimeError as error:
        raise ExpertError(str(error)) from error
    runs = play(env, script, wanted, tell)
    episodes = [
        Episode(
            run.kind, "success" if run.succeeded else "failure", run,
            dict(zip(env.stage_names, run.stage_time.tolist(), strict=True)),
        )
        for run in runs
    ]  # fmt: skip
    return Demonstrations(env, env.classes, episodes, _films(env, renderer, runs))


def play(env: Tabletop, script: Script, wanted: Wanted, tell: Callable[[int], None]) -> list[Run]:
    """Plays successes, then failures of all kinds in turn; keeps episodes that match their label.

    Raises:
      ExpertError: the expert fails too often.
    """
    success, *failures = script.kinds
    kinds = [success] * wanted.successes
    kinds += [failures[i % len(failures)] for i in range(wanted.failures)]
    runs: list[Run] = []
    tries = zip(range(_PATIENCE * len(kinds)), _starts(env, wanted.seed), strict=False)
    for number, start in tries:
        run = script.play(env, start, (wanted.seed, number), kinds[len(runs)])
        if script.as_meant(run):
            runs.append(run)
            tell(len(runs))
        if len(runs) == len(kinds):
            return runs
    raise ExpertError(
        f"the scripted expert played {len(runs)} of {len(kinds)} demonstrations as it should in "
        f"{_PATIENCE * len(kinds)} episodes, so the set cannot be made"
    )


def _starts(env: Tabletop, seed: int) -> Iterator[State]:
    """Endless starts, without those that found no room for the objects."""
    reset = _reset(env)
    key = jax.random.key(seed)
    while True:
        key, drawn = jax.random.split(key)
        states = jax.device_get(reset(jax.random.split(drawn, _BATCH)))
        for index in np.flatnonzero(~states.data.unplaced):
            yield jax.tree.map(lambda x, i=index: x[i], states)


@functools.lru_cache(maxsize=1)  # what is compiled for an environment serves as long as it does
def _reset(env: Tabletop) -> Callable:
    return jax.jit(jax.vmap(env.reset))


def _films(env: Tabletop, renderer: Renderer, runs: list[Run]) -> Iterator[Film]:
    """Videos of the episodes in turn; the renderer is closed after the last."""
    try:
        for run in runs:
            pictures = [renderer.picture(qpos, run.fixtures) for qpos in run.qpos]
            seen = stacked([detect(p.thing, len(env.classes)) for p in pictures])
            yield Film(np.stack([p.frame for p in pictures]), *carried(seen, env.classes))
    finally:
        renderer.close()


def detect(thing: Int8[np.ndarray, "P P"], count: int, *, least: int = 4) -> Sightings:
    """The boxes of the visible pixels of `count` things; one with fewer than `least` is not seen.

    `thing` is the index of what each pixel shows, row 0 on top; below 0 for none.
    """
    pixels = len(thing)
    low, high = np.zeros((2, count, 2), np.float32)
    seen = np.zeros(count, bool)
    for index in range(count):
        mask = thing == index
        if np.count_nonzero(mask) < least:
            continue
        columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
        low[index] = columns[0], pixels - 1 - rows[-1]
        high[index] = columns[-1] + 1, pixels - rows[0]
        seen[index] = True
    scale = np.float32(2 / pixels)
    center = np.where(seen[:, None], (low + high) / 2 * scale - 1, 0).astype(np.float32)
    return Sightings(center, (high - low) * scale, seen)


def stacked(frames: list[Sightings]) -> Sightings:
    """Stacks the frames of one video, in order."""
    return Sightings(*(np.stack(parts) for parts in zip(*frames, strict=True)))


def carried(seen: Sightings, names: tuple[str, ...]) -> Sightings:
    """Fills unseen frames with the last box; frames before the first sighting get the first box.

    Raises:
      ExpertError: a thing, by its name, is seen in no frame.
    """
    never = np.flatnonzero(~seen.seen.any(axis=0))
    if len(never):
        name = names[never[0]]
        raise ExpertError(f"{name!r} is not to be seen in any of {len(seen.seen)} frames")
    times = np.where(seen.seen, np.arange(len(seen.seen))[:, None], -1)
    source = np.maximum.accumulate(times)
    source = np.where(source < 0, seen.seen.argmax(axis=0), source)[..., None]
    center, size = (np.take_along_axis(x, source, axis=0) for x in (seen.center, seen.size))
    return Sightings(center, size, seen.seen)


class Entry:
    """A task and its scripted expert; what is compiled for one environment serves as long as it.

    `moments()` are states of the expert's episodes, at which training may begin.
    """

    def __init__(self, task: Task, script: Script):
        self.task, self.script = task, script
        self.moments = functools.cache(self._recorded)
        self._demonstrated = functools.lru_cache(maxsize=1)(self.make)

    def make(self, *, varied_starts: float = 0.0, **options) -> Tabletop:
        """The environment; other `options` are those of `Tabletop`.

        `varied_starts` is the share of the episodes that begin within one of a scripted expert,
        which is played first (10 s on 2 CPU cores).
        """
        found = self.moments() if varied_starts else None
        return Tabletop(self.task, varied_starts=varied_starts, moments=found, **options)

    def _recorded(self) -> Moments:
        """States of the expert, recorded once a process: no option of an episode changes them."""
        return moments(Tabletop(self.task), self.script.perform)

    def demonstrate(
        self, make: Callable[..., Tabletop], wanted: Wanted, tell: Callable[[int], None]
    ) -> Demonstrations:
        """The demonstrations wanted; a `gril_jax.envs.base.Demonstrate`.

        The expert plays with the task's own settings: whatever options a policy has, the
        demonstrations stay the same.
        """
        del make
        env = self._demonstrated(jitter=JITTER[wanted.places])
        return record(env, self.script, wanted, tell)
