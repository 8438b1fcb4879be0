"""Things that scripted experts hold, found again in the boxes of their videos."""

import importlib

import jax
import numpy as np
import pytest
from gril_jax.envs.base import Wanted
from gril_jax.envs.panda.kinematics import tcp

from gril_jax import envs
from gril_jax.demos.tracking.held import with_held

ROBOT, LEAST = [0, 1, 2], 0.95  # share of frames
LED, ALIKE = 0.004, 0.002  # metres a frame: the hand moves, and a thing with it


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", ["shoes_in_box", "shoes_out_of_box", "rubbish_in_bin", "empty_container",
             "item_in_drawer", "umbrella_out"],
)  # fmt: skip
def test_what_moves_with_the_hand_is_in_it_where_frames_of_the_video_are_placed(task):
    entry = importlib.import_module(f"gril_jax.envs.tabletop.tasks.{task}").ENTRY
    made = envs.demonstrate(task)(entry.make, Wanted(2, 0, 0, "layout"), lambda done: None)
    env, shares = made.env, []
    place = jax.jit(jax.vmap(lambda *of: _in_hand(env, env.place_held(*of))))
    loose = np.arange(len(env.classes) - len(env.task.layout.loose), len(env.classes))
    for episode, film in zip(made.episodes, made.films, strict=True):
        found = with_held(film.center, film.size, ROBOT)
        frames, which = np.nonzero(_moved(episode.data, loose))
        keys = jax.random.split(jax.random.key(0), len(frames))
        held, away = place(found.center[frames], found.size[frames], keys, found.held[frames])
        away = np.asarray(away)[:, loose]
        shares += (np.asarray(held) & (away.argmin(axis=1) == which)).tolist()
    assert np.mean(shares) >= LEAST


def _moved(run, loose):
    """True (T, L) in frames in which a thing has come along with the moving hand."""
    tool = np.asarray(jax.vmap(lambda qpos: tcp(qpos[:7]).position)(run.qpos))
    from_hand = np.asarray(run.boxes.position)[:, loose] - tool[:, None]
    led = np.linalg.norm(np.diff(tool, axis=0, prepend=tool[:1]), axis=-1) > LED
    off = np.linalg.norm(np.diff(from_hand, axis=0, prepend=from_hand[:1]), axis=-1)
    return led[:, None] & (off < ALIKE)


def _in_hand(env, state):
    """True where the gripper presses, and how far things are from the tool centre point, metres."""
    tool = tcp(state.data.motion.qpos[:7]).position
    away = env.world_boxes(state.data).position - tool
    return state.data.target[7] < 0, jax.numpy.linalg.norm(away, axis=1)
