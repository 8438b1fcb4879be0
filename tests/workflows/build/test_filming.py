"""Films of episodes: painted where OpenGL works, outlines elsewhere."""

import jax
import numpy as np
import pytest
from gril_jax.envs.tabletop import render

from gril_jax import envs
from gril_jax.workflows.build import filming


@pytest.fixture(scope="module")
def table():
    """The shoes, and an episode of three moments whose lid opens."""
    env = envs.make("shoes_in_box", jitter=0.0)
    start = jax.jit(env.reset)(jax.random.key(0))
    states = jax.tree.map(lambda x: np.stack([x] * 3), jax.device_get(start))
    states.data.motion.qpos[:, 9] = [0.0, 1.0, 2.0]
    return env, states


def test_a_table_is_painted_with_its_arm(table):
    env, states = table
    try:
        render.Renderer(env, jax.tree.map(lambda x: x[0], states)).close()
    except RuntimeError as error:
        pytest.skip(str(error))
    film = filming.episode(env, states)
    assert (film.shape, film.dtype) == ((3, 384, 384, 3), np.uint8)
    assert not (film == 0).all(axis=-1).any()  # behind the table is the ground of all pictures
    assert (film[:, 0, 0] == env.background).all()
    red, green, blue = np.moveaxis(film, -1, 0).astype(int)
    table = ((red > green + 15) & (green > blue + 15)).mean(axis=(1, 2))  # no outline is so brown
    assert ((table > 0.3) & (table < 0.8)).all(), table
    assert (film[0] != film[1]).any()
    assert (film[1] != film[2]).any()


def test_without_opengl_outlines_take_its_place(table, monkeypatch):
    def missing(*_, **__):
        raise RuntimeError("no OpenGL works here")

    env, states = table
    monkeypatch.setattr(filming, "Renderer", missing)
    np.testing.assert_array_equal(filming.episode(env, states), filming.outlines(env, states.data))


def test_an_arena_is_outlines():
    env = envs.make("match_regions")
    start = jax.jit(env.reset)(jax.random.key(0))
    film = filming.episode(env, jax.tree.map(lambda x: x[None], start))
    assert (film.shape, film.dtype) == ((1, 384, 384, 3), np.uint8)
    assert np.ptp(film) > 100
