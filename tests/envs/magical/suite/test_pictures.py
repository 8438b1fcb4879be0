"""Pictures of the suite from the device beside those that the host paints."""

import functools

import jax
import numpy as np
import pytest
from support.raster_pictures import compare

from gril_jax import envs
from gril_jax.workflows.build import filming as host


@functools.cache
def _env(name):
    return envs.make(name, engine="impulse", variant="all", padded=True)


@pytest.mark.parametrize("name", ["move_to_corner", "fix_colour", "cluster_shape"])
def test_a_picture_is_the_hosts_but_for_a_pixel_at_its_edges(name):
    env = _env(name)
    states = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), 3))
    pictures = np.asarray(jax.jit(jax.vmap(env.render))(states.data))
    for i, ours in enumerate(pictures):
        outlines = env.outlines(jax.tree.map(lambda x, i=i: x[i], states.data))
        look = {"half_extent": env.half_extent, "background": env.background, "pixels": 384}
        differ, differ_much, stray = compare(ours, host.paint(outlines, **look))
        assert not stray
        assert differ < 0.08
        assert differ_much < 0.03


def test_what_is_not_there_leaves_no_trace():
    env = _env("find_dupe")
    data = jax.jit(env.reset)(jax.random.key(0)).data
    draw = jax.jit(env.render)
    nowhere = np.tile([2.0, -1, 0, 0], (len(data.regions), 1)).astype(np.float32)
    gone = data._replace(pose=data.pose.at[3:, 0].set(2.0), regions=nowhere)
    floor_and_robot = {
        (231, 231, 234), (255, 255, 255), (162, 163, 175), (144, 145, 159), (26, 26, 26),
    }  # fmt: skip
    assert {tuple(map(int, rgb)) for rgb in np.unique(draw(gone).reshape(-1, 3), axis=0)} == (
        floor_and_robot
    )
    assert len(np.unique(draw(data).reshape(-1, 3), axis=0)) > len(floor_and_robot) + 4


@pytest.mark.parametrize(("name", "hidden"), [("fix_colour", False), ("move_to_corner", True)])
def test_a_robot_below_the_blocks_is_hidden_by_them(name, hidden):
    env = _env(name)
    data = jax.jit(env.reset)(jax.random.key(0)).data
    data = data._replace(pose=data.pose.at[3, :2].set(data.pose[0, :2]))
    (x, y), scale = np.asarray(data.pose[0, :2]), 384 / (2 * env.half_extent)
    row, column = int((env.half_extent - y) * scale), int((env.half_extent + x) * scale)
    pixel = tuple(np.asarray(jax.jit(env.render)(data))[row, column])
    assert (pixel != (162, 163, 175)) == hidden
