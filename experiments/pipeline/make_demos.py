"""Scripted demonstrations: the expert acts, its videos are written, and the detector reads them.

    gril demos make quickstart --out DEMOS        about half a minute on two CPU cores

Nothing but the videos reaches the demonstration set: boxes come from their frames.
"""

import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs.magical.expert import scripted

from gril_jax.config import MakeDemosConfig, RunConfig
from gril_jax.demos.importing import Imported, import_videos
from gril_jax.demos.vision import video
from gril_jax.errors import DemoError
from gril_jax.runs.progress import Progress
from gril_jax.threads import parallel_map

from . import filming, setup, shoes_demos

__all__ = ["main", "make"]

_SPARE = 2  # successes played for each that is kept: the brisker half, as a person would choose
_ROUNDS = 8  # batches of episodes before giving up on an expert that fails
_AFTER = 12  # frames that a video goes on once the task is done
_JITTER = {"demo": 0.0, "jitter": 0.5, "layout": 1.0}  # of starts on a table, by the variant


def main(config: MakeDemosConfig, out: Path, echo: Callable[[str], None] = print) -> None:
    """Write a demonstration set to `out`."""
    with Progress() as progress:
        made = make(config, out, progress)
    trimmed, frames = sum(m.trimmed for m in made), sum(m.frames for m in made)
    echo(f"wrote {len(made)} demonstrations of {frames} frames to {out} ({trimmed} trimmed)")


def make(config: MakeDemosConfig | RunConfig, out: Path, progress: Progress) -> list[Imported]:
    """Play the expert, film it, and import the videos into a demonstration set at `out`.

    A task on a table has an expert, a camera and a detector of its own: see `shoes_demos`.

    Raises:
      DemoError: the expert fails so often that the demonstrations wanted cannot be collected.
    """
    if config.env.name == "shoes_in_box":
        chosen = config.demos
        return shoes_demos.make(
            out,
            progress,
            num=chosen.num + chosen.num_validation,
            failures=chosen.num_failures,
            seed=chosen.seed,
            jitter=_JITTER[chosen.variant],
        )
    # The gripper demonstrates, whichever robot will learn: the reward does not see the robot.
    scene = dataclasses.replace(config.env, robot="gripper", observation="rich")
    env = setup.make_env(scene, training=False, variant=config.demos.variant)
    env.episode_length = env.episode_length * 4 // 3  # the expert is slower than a policy
    wanted = config.demos.num + config.demos.num_validation
    episodes = _play(env, wanted, config.demos.num_failures, config.demos.seed, progress)
    with tempfile.TemporaryDirectory() as scratch:
        phase = progress.phase("filming", total=len(episodes), unit="videos", compiles=False)

        def shoot(episode):
            number, (data, outcome) = episode
            path = Path(scratch) / f"{number:03d}_{outcome}.mp4"
            video.write_video(path, filming.outlines(env, data), env.control_hz)

        for done, _ in enumerate(parallel_map(shoot, enumerate(episodes)), 1):
            phase.update(done)
        phase = progress.phase("detecting", total=len(episodes), unit="videos", compiles=False)
        return import_videos(
            scratch,
            out,
            env.half_extent,
            config.env.name,
            classes=env.classes,
            objects=("goal", "robot", *env.blocks),
            outcome={f"{i:03d}_{o}": o for i, (_, o) in enumerate(episodes)},
            source=f"scripted expert, {config.demos.variant} layout, seed {config.demos.seed}",
            progress=lambda done, total, last: phase.update(done),
        )


def _play(env, wanted: int, failures: int, seed: int, progress: Progress) -> list:
    """Simulator data (T, ...) and outcome of each episode: successes first, then failures."""
    played = _SPARE * wanted
    batch = played + failures + wanted // 3
    kinds = jnp.zeros(batch, jnp.int32)
    if failures:
        kinds = kinds.at[-failures:].set(1 + jnp.arange(failures) % (len(scripted.FAILURES) - 1))
    rollout = jax.jit(jax.vmap(lambda key, kind: scripted.rollout(env, key, kind)[0]))
    phase = progress.phase("playing the expert", total=wanted + failures, unit="episodes")
    good, bad = [], []
    for number in range(_ROUNDS):
        keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), number), batch)
        states = jax.device_get(rollout(keys, kinds))
        for lane in range(batch):
            done = states.metrics["success"][lane]
            data = jax.tree.map(lambda x, lane=lane: x[lane], states.data)
            if kinds[lane] == 0 and done[-1] > 0:
                # From the end backwards: the moment after which it stays done.
                end = len(done) - int(np.argmin(done[::-1] > 0)) if not done.all() else 1
                good.append((jax.tree.map(lambda x, e=end: x[: e + _AFTER], data), "success"))
            elif kinds[lane] > 0 and done[-1] == 0:
                bad.append((data, "failure"))
        phase.update(min(len(good) // _SPARE, wanted) + min(len(bad), failures))
        if len(good) >= played and len(bad) >= failures:
            slowest = sorted(len(data.goal) for data, _ in good[:played])[wanted - 1]
            brisk = [g for g in good[:played] if len(g[0].goal) <= slowest]
            return brisk[:wanted] + bad[:failures]
    raise DemoError(
        f"the scripted expert solved {len(good)} of {_ROUNDS * batch} episodes of the "
        f"{env.variant} layout, but demos.num and demos.num_validation ask for {wanted}"
    )
