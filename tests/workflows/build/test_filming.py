"""Videos of episodes: painted where OpenGL works, outlines elsewhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.base import Outline
from gril_jax.envs.tabletop import render
from support import scenes

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


SCALE = 384 / (2 * 1.122)  # pixels a world unit
WHITE, OUTSIDE, PALE = (255, 255, 255), (231, 231, 234), (224, 231, 191)


@pytest.fixture(scope="module")
def env():
    return envs.make("match_regions")


@pytest.fixture(scope="module")
def data(env):
    return jax.jit(env.reset)(jax.random.key(0)).data


@pytest.fixture(scope="module")
def frame(env, data):
    return _paint(env, data)


def _paint(env, data, **options):
    return filming.paint(
        env.outlines(data), half_extent=env.half_extent, background=env.background, **options
    )


def _pixel(x, y, pixels=384):
    """Row and column of a world point."""
    scale = pixels / (2 * 1.122)
    return int((1.122 - y) * scale), int((x + 1.122) * scale)


def _mask(frame, colours, tolerance=12):
    near = [np.abs(frame.astype(int) - colour).max(axis=2) <= tolerance for colour in colours]
    return np.any(near, axis=0)


def _box(mask):
    """Left, top, width and height."""
    rows, columns = np.nonzero(mask)
    return columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1


def _around(mask, x, y, reach=34):
    row, column = _pixel(x, y)
    part = np.zeros_like(mask)
    window = np.s_[max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach]
    part[window] = mask[window]
    return part


def test_region_is_where_the_reference_has_it(env):
    """Its pale fill alone: the dashes on its border stand out by half their width."""
    region = env.outlines(jax.jit(env.reset)(jax.random.key(0)).data)[1]._replace(rim=None)
    image = filming.paint([region], half_extent=env.half_extent, background=WHITE)
    left, top, width, height = _box(_mask(image, [PALE], 1))
    assert (left, top) == pytest.approx((209, 72), abs=1.0)
    assert (width, height) == pytest.approx((102.7, 119.8), abs=1.2)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("green star", (51, 51)),
        ("green square", (47, 47)),
        ("blue pentagon", (46, 46)),
        ("yellow circle", (43, 43)),
        ("yellow pentagon", (47, 46)),
    ],
)
def test_blocks_are_where_and_as_large_as_in_the_reference_frame(frame, name, size):
    x, y, _ = scenes.BLOCKS[name]
    fill, rim, _ = scenes.COLOURS[name.split()[0]]
    # Edges are smooth here, not in the reference: a pixel counts if it is half covered.
    left, top, width, height = _box(_around(_mask(frame, [fill, rim], 60), x, y))
    assert (width, height) == pytest.approx(size, abs=2)
    vertices = scenes.placed(scenes.corners(name.split()[1]), *scenes.BLOCKS[name])
    assert left == pytest.approx((vertices[:, 0].min() + 1.122) * SCALE, abs=2)
    assert top == pytest.approx((1.122 - vertices[:, 1].max()) * SCALE, abs=2)


@pytest.mark.parametrize(
    ("point", "colour"),
    [
        ((0.4, 0.35), PALE),
        ((0.0, 0.9), WHITE),
        ((-1.12, 0.0), OUTSIDE),
        ((1.12, 1.12), OUTSIDE),
        ((-0.5, 0.1), (162, 163, 175)),
    ],
)
def test_floor_border_region_and_robot_have_the_references_colours(frame, point, colour):
    assert tuple(frame[_pixel(*point)]) == colour


def test_region_border_is_dashed(frame):
    """A dash every twenty pixels along the left side, in the blocks' green, with gaps."""
    column = _pixel(0.1, 0.35)[1]
    side = _mask(frame, [(195, 208, 130)], 25)[76:188, column]
    begins = np.flatnonzero(np.diff(side.astype(int)) == 1)
    assert len(begins) == 5
    np.testing.assert_allclose(np.diff(begins), 20, atol=1)
    # The reference has 10 on and 10 off; round ends of the thick line add a few pixels here.
    assert 0.4 < side.mean() < 0.8


def test_later_outlines_hide_earlier_ones(env, data):
    """Blocks over the region, robot over blocks."""
    pose = np.array(data.pose)
    pose[3] = 0.4, 0.35, 0.0
    image = _paint(env, data._replace(pose=jnp.asarray(pose)))
    assert tuple(image[_pixel(0.4, 0.35)]) == (195, 208, 130)
    pose[0, :2] = 0.4, 0.35
    image = _paint(env, data._replace(pose=jnp.asarray(pose)))
    assert tuple(image[_pixel(0.4, 0.35)]) == (162, 163, 175)


@pytest.mark.parametrize("pixels", [96, 192, 768])
def test_other_resolutions_show_the_same_scene(env, data, frame, pixels):
    image = _paint(env, data, pixels=pixels)
    assert image.shape == (pixels, pixels, 3)
    for name, (x, y, _) in scenes.BLOCKS.items():
        fill, *_ = scenes.COLOURS[name.split()[0]]
        assert tuple(image[_pixel(x, y, pixels)]) == fill
    covered = [
        _mask(picture, [(135, 185, 211), (110, 170, 202)], 30).mean() for picture in (image, frame)
    ]
    assert covered[0] == pytest.approx(covered[1], rel=0.15)


def test_painting_is_deterministic_and_keeps_its_input(env, data, frame):
    outlines = env.outlines(data)
    before = [o.vertices.copy() for o in outlines]
    again = filming.paint(outlines, half_extent=env.half_extent, background=env.background)
    np.testing.assert_array_equal(again, frame)
    for outline, vertices in zip(outlines, before, strict=True):
        np.testing.assert_array_equal(outline.vertices, vertices)


def test_half_of_the_world_is_half_of_the_pixels_with_y_up_and_what_is_beyond_is_cut_off():
    upper = Outline(np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]]), (9, 9, 9), None)
    far = Outline(np.array([[5.0, 5.0], [6.0, 5.0], [6.0, 6.0]]), (9, 9, 9), (8, 8, 8), 4, 10)
    image = filming.paint([upper, far], half_extent=1.0, background=(1, 2, 3), pixels=64)
    assert (image[:30] == 9).all()  # the border itself is smooth
    assert (image[35:] == (1, 2, 3)).all()
