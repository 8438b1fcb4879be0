"""Demonstrations of a table task: its scripted expert is filmed, and a detector reads the boxes.

The expert plays in C MuJoCo at the control rate, and each moment is a frame. World units are those
of the picture: half its width, so that `half_extent` is 1 and the middle of a frame is (0, 0), y
up. Boxes are those of the visible pixels: a thing that is partly hidden has a smaller box, one that
is wholly hidden keeps its last.
"""

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from gril_jax.envs.base import Demonstrations, Episode, ExpertError, Film, State, Wanted

from . import detector
from .recorded import Run
from .render import Renderer
from .task import Tabletop

JITTER = {"demo": 0.0, "jitter": 0.5, "layout": 1.0}  # of starts, by `Wanted.places`
_BATCH = 32  # starts drawn at once
_PATIENCE = 4  # episodes played for each that is wanted, at most
_PIXELS = 256


class Expert(NamedTuple):
    """A task's scripted expert."""

    kinds: tuple[str, ...]  # "success", then the failures in the order in which they are shown
    play: Callable[[Tabletop, State, tuple[int, int], str], Run]  # (env, start, seed, kind)
    as_meant: Callable[[Run], bool]  # whether an episode succeeds, or fails, as its kind says


def record(
    env: Tabletop, expert: Expert, wanted: Wanted, tell: Callable[[int], None]
) -> Demonstrations:
    """The demonstrations wanted; the jitter of their starts is the environment's.

    Raises:
      ExpertError: there is no OpenGL, a thing is never seen, or the expert fails too often.
    """
    try:
        renderer = Renderer(env, next(_starts(env, wanted.seed)), pixels=_PIXELS)
    except RuntimeError as error:
        raise ExpertError(str(error)) from error
    runs = play(env, expert, wanted, tell)
    episodes = [
        Episode(
            run.kind, "success" if run.succeeded else "failure", run,
            dict(zip(env.stage_names, run.stage_time.tolist(), strict=True)),
        )
        for run in runs
    ]  # fmt: skip
    return Demonstrations(env, env.classes, episodes, _films(env, renderer, runs))


def play(env: Tabletop, expert: Expert, wanted: Wanted, tell: Callable[[int], None]) -> list[Run]:
    """Plays successes, then failures of all kinds in turn; keeps episodes that match their label.

    Raises:
      ExpertError: the expert fails too often.
    """
    success, *failures = expert.kinds
    kinds = [success] * wanted.successes
    kinds += [failures[i % len(failures)] for i in range(wanted.failures)]
    runs: list[Run] = []
    tries = zip(range(_PATIENCE * len(kinds)), _starts(env, wanted.seed), strict=False)
    for number, start in tries:
        run = expert.play(env, start, (wanted.seed, number), kinds[len(runs)])
        if expert.as_meant(run):
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
    """Films of the episodes in turn; the renderer is closed after the last."""
    try:
        for run in runs:
            pictures = [renderer.picture(qpos, run.fixtures) for qpos in run.qpos]
            seen = detector.stacked([detector.detect(p.thing, len(env.classes)) for p in pictures])
            never = np.flatnonzero(~seen.seen.any(axis=0))
            if len(never):
                raise ExpertError(
                    f"{env.classes[never[0]]!r} is not to be seen in any of {len(pictures)} frames"
                )
            yield Film(np.stack([p.frame for p in pictures]), *detector.carried(seen))
    finally:
        renderer.close()
