"""Demonstrations of shoes in the box: a scripted expert is filmed, and a detector reads the boxes.

    gril demos make shoes_in_box --out DEMOS

The expert plays in C MuJoCo (`gril_jax.envs.tabletop.shoes_in_box.expert`) at the control rate, and
each moment is a frame. World units are those of the picture: half its width, so that `half_extent`
is 1 and the middle of a frame is (0, 0), y up. Boxes are

  "detected"  those of the visible pixels, as a detector would report them: a thing that is partly
              hidden has a smaller box, one that is wholly hidden keeps its last; noise on demand
  "whole"     those of whole things, as `Objects` has them when a policy learns
"""

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import jax
import numpy as np
from gril_jax.envs.tabletop import detector
from gril_jax.envs.tabletop.render import Renderer
from gril_jax.envs.tabletop.shoes_in_box import expert
from gril_jax.envs.tabletop.task import Tabletop

from gril_jax import envs
from gril_jax.demos.demo_set import Demo, save_demo_set
from gril_jax.demos.importing import Imported
from gril_jax.demos.vision.detect import Tracks
from gril_jax.errors import DemoError
from gril_jax.runs.progress import Progress

__all__ = ["FAILURES", "make", "play"]

FAILURES = tuple(kind for kind in expert.KINDS if kind != "success")
_BATCH = 32  # starts drawn at once
_PATIENCE = 4  # episodes played for each that is wanted, at most
_LIKE = (("left finger", "right finger"), ("shoe A", "shoe B"))  # what a detector may mix up


class _Film(NamedTuple):
    """How episodes are filmed and read."""

    env: Tabletop
    renderer: Renderer
    boxes: str
    noise: detector.Noise


def make(
    out: Path,
    progress: Progress,
    *,
    num: int,
    failures: int,
    seed: int = 0,
    jitter: float = 1.0,
    pixels: int = 256,
    boxes: Literal["detected", "whole"] = "detected",
    noise: detector.Noise = detector.EXACT,
) -> list[Imported]:
    """Play, film, detect, and save a demonstration set.

    Args:
      out: the folder; replaced if it is a demonstration set already.
      progress: shows two phases.
      num, failures: how many successes, and failures of all kinds in turn.
      seed: of starts, styles and noise.
      jitter: share of the ranges of the starts' randomness.
      pixels: width and height of the frames, even.
      boxes: see the module's text.
      noise: of the detector.

    Returns:
      What was saved, named after its number and kind.

    Raises:
      DemoError: there is no OpenGL, a thing is never seen, or the expert fails too often.
    """
    env = _env(jitter)
    try:
        renderer = Renderer(env, next(_starts(env, seed)), pixels=pixels)
    except (RuntimeError, ValueError) as error:
        raise DemoError(f"{out}: {error}.") from error
    runs = play(env, num, failures, seed, progress)
    phase = progress.phase("filming", total=len(runs), unit="videos", compiles=False)
    film, report = _Film(env, renderer, boxes, noise), []

    def demos() -> Iterator[Demo]:
        for number, run in enumerate(runs):
            name = f"{number:03d}_{run.kind.replace(' ', '_')}"
            demo = _demo(film, run, name, np.random.default_rng((seed, number)))
            yield demo
            report.append(
                Imported(name, len(run.qpos), 0, demo.outcome, float(demo.tracks.seen.mean()))
            )
            phase.update(number + 1)

    try:
        save_demo_set(
            out, demos(), task="shoes_in_box", classes=env.classes, half_extent=env.half_extent,
            fps=env.control_hz, source=f"scripted expert, boxes {boxes}, seed {seed}",
        )  # fmt: skip
    finally:
        renderer.close()
    return report


def play(env: Tabletop, num: int, failures: int, seed: int, progress: Progress) -> list[expert.Run]:
    """Successes first, then failures of all kinds in turn; only episodes that are as meant.

    Raises:
      DemoError: the expert fails too often.
    """
    wanted = ["success"] * num + [FAILURES[i % len(FAILURES)] for i in range(failures)]
    phase = progress.phase("playing the expert", total=len(wanted), unit="episodes")
    runs: list[expert.Run] = []
    for number, start in zip(range(_PATIENCE * len(wanted)), _starts(env, seed), strict=False):
        run = expert.play(env, start, (seed, number), wanted[len(runs)])
        if run.as_meant:
            runs.append(run)
            phase.update(len(runs))
        if len(runs) == len(wanted):
            return runs
    raise DemoError(
        f"the scripted expert played {len(runs)} of {len(wanted)} demonstrations as it should in "
        f"{_PATIENCE * len(wanted)} episodes, so the set cannot be made"
    )


def _starts(env: Tabletop, seed: int) -> Iterator[envs.State]:
    """Starts without end, leaving out those in which things did not find room."""
    reset = _reset(env)
    key = jax.random.key(seed)
    while True:
        key, drawn = jax.random.split(key)
        states = jax.device_get(reset(jax.random.split(drawn, _BATCH)))
        for lane in np.flatnonzero(~states.data.unplaced):
            yield jax.tree.map(lambda x, i=lane: x[i], states)


@functools.lru_cache(maxsize=1)  # what is compiled for an environment serves as long as it does
def _env(jitter: float) -> Tabletop:
    return envs.make("shoes_in_box", jitter=jitter)


@functools.lru_cache(maxsize=1)
def _reset(env: Tabletop):
    return jax.jit(jax.vmap(env.reset))


def _demo(film: _Film, run: expert.Run, name: str, rng: np.random.Generator) -> Demo:
    """One episode as frames and boxes."""
    classes = film.env.classes
    pictures = [film.renderer.picture(qpos, run.fixtures) for qpos in run.qpos]
    seen = detector.stacked([detector.detect(p.thing, len(classes)) for p in pictures])
    if film.boxes == "whole":
        seen = detector.Sightings(run.center, run.size, np.ones_like(seen.seen))
    twins = tuple((classes.index(a), classes.index(b)) for a, b in _LIKE)
    if film.noise != detector.EXACT:
        pixels = film.renderer.pixels
        seen = detector.disturbed(seen, film.noise, rng, pixels=pixels, twins=twins)
    never = np.flatnonzero(~seen.seen.any(axis=0))
    if len(never):
        raise DemoError(
            f"{name}: {classes[never[0]]!r} is not to be seen in any of {len(run.qpos)} frames."
        )
    center, size, visible = detector.carried(seen)
    tracks = Tracks(center, size, np.arange(len(classes), dtype=np.int32), visible)
    outcome = "success" if run.succeeded else "failure"
    stages = dict(zip(film.env.stage_names, run.stage_time.tolist(), strict=True))
    return Demo(name, np.stack([p.frame for p in pictures]), tracks, 0, outcome, stages)
