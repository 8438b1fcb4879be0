"""Moments of the scripted expert's successes in shoes in the box, for varied starts of training."""

import jax
import numpy as np
from gril_jax.envs.tabletop.moments import Moments
from gril_jax.envs.tabletop.task import Tabletop

from . import expert

__all__ = ["moments"]

_EVERY = 4  # control steps: fifth parts of a second
_MOVED = 0.005  # box diagonals: the paper's tau


def moments(env: Tabletop, *, episodes: int = 24) -> Moments:
    """Every fourth moment of some successes, up to where success begins.

    Args:
      env: shoes in the box, controller "ee_delta_yaw".
      episodes: to play, 0.2 s each; a few of them may fail, and are left out.
    """
    starts = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), episodes))
    found = []
    for number in range(episodes):
        start = jax.tree.map(lambda x, i=number: x[i], starts)
        hand = expert.perform(env, start, np.random.default_rng((0, number)))
        run = expert.judge(
            env, start, "success", np.stack(hand.positions), np.stack(hand.velocities)
        )
        if run.succeeded:
            found.append(_of(run, np.stack(hand.targets)))
    return Moments(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _of(run: expert.Run, target) -> Moments:
    chosen = np.arange(0, int(run.success.argmax()), _EVERY)
    diagonal = np.linalg.norm(run.size[0], axis=-1)
    away = np.linalg.norm(run.center - run.center[0], axis=-1) > _MOVED * diagonal
    reached = np.logical_or.accumulate(run.stages, axis=0)
    best = np.maximum.accumulate(run.stages.sum(axis=1))
    fixtures = np.broadcast_to(run.fixtures, (len(run.qpos), *run.fixtures.shape))
    everything = Moments(
        run.qpos, run.qvel, target, fixtures, reached, best, np.logical_or.accumulate(away, axis=0)
    )
    return Moments(*(part[chosen] for part in everything))
