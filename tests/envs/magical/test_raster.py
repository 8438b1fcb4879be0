"""Pictures from the device against exact geometry and against those that the host paints."""

import functools
import math

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical import raster
from gril_jax.envs.magical import scene as look
from gril_jax.envs.planar import robots
from support import scenes
from support.raster_pictures import (
    DEMO,
    HALF,
    NOWHERE,
    STICKS,
    compare,
    demo_arguments,
    exact_picture,
    made_scene,
    near_edge,
    random_arguments,
)

from gril_jax.workflows.build import filming as host


@functools.cache
def _jitted(**options):
    return jax.jit(functools.partial(raster.render, **options))


def _render(scene, **options):
    return np.asarray(_jitted(**options)(scene))


@pytest.mark.parametrize(
    ("seed", "size"), [(0, 384), (1, 97), (2, 64), (3, 384), (4, 200), (5, 128)]
)
def test_every_pixel_is_that_of_the_exact_shapes(seed, size):
    arguments = random_arguments(seed)
    exact = exact_picture(*arguments, size=size)
    wrong = (_render(made_scene(*arguments), size=size) != exact.image).any(axis=2)
    assert not (wrong & ~exact.doubt).any()
    assert exact.doubt.mean() < 0.02


@pytest.mark.parametrize("stick", STICKS)
def test_every_pixel_of_a_stick_is_that_of_the_exact_shape(stick):
    arguments = random_arguments(5, fingers=False)
    exact = exact_picture(*arguments, stick=stick)
    wrong = (_render(made_scene(*arguments), robot=stick) != exact.image).any(axis=2)
    assert not (wrong & ~exact.doubt).any()


# ---------------------------------------------------------------- the host's picture


def _paint(names, blocks, robot, fingers, goal, colour, *, stick=None, pixels=384):
    """As the task paints on the host; the first block's colour is the region's."""
    scene = made_scene(names, blocks, robot, fingers, goal, colour)
    made = robots.robot(stick or "gripper")
    pose = np.asarray(scene.pose, np.float64)
    blocks = [tuple(n.split()) for n in names]
    regions = [(blocks[0][0], np.array(goal))]
    outlines = look.outlines(made, blocks, 1.1, pose, regions)
    return host.paint(outlines, half_extent=HALF, background=look.BACKGROUND, pixels=pixels)


@pytest.mark.parametrize("antialias", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_picture_is_the_hosts_but_for_a_pixel_at_its_edges(seed, antialias):
    arguments = random_arguments(10 + seed)
    ours = _render(made_scene(*arguments), antialias=antialias)
    differ, differ_much, stray = compare(ours, _paint(*arguments))
    assert not stray
    assert differ < 0.08  # OpenCV draws lines half a pixel broader on each side, and smooth
    assert differ_much < 0.03


def test_demo_boxes_are_the_references():
    """Bounding boxes that were read off the reference's own frame, to a pixel a side."""
    image = _render(made_scene(*demo_arguments()))
    for name, box in zip(DEMO, ((51, 51), (47, 47), (46, 46), (43, 43), (47, 46)), strict=True):
        fill, rim, _ = scenes.COLOURS[name.split()[0]]
        x, y, _ = scenes.BLOCKS[name]
        row, column = int((HALF - y) * 171.12), int((x + HALF) * 171.12)
        part = image[row - 32 : row + 32, column - 32 : column + 32]
        mask = (part == fill).all(axis=2) | (part == rim).all(axis=2)
        rows, columns = np.nonzero(mask)
        assert (np.ptp(columns) + 1, np.ptp(rows) + 1) == pytest.approx(box, abs=2), name


# ---------------------------------------------------------------- smooth edges


@pytest.mark.parametrize("size", [96, 192])
def test_smooth_picture_is_the_mean_of_a_finer_one(size):
    factor = 1536 // size
    scene = made_scene(*random_arguments(40))
    fine = _render(scene, size=1536).astype(float)
    mean = fine.reshape(size, factor, size, factor, 3).mean(axis=(1, 3))
    smooth = _render(scene, size=size, antialias=True)
    error = np.abs(smooth - mean).max(axis=2)
    assert error.mean() < 0.5
    assert np.quantile(error, 0.99) < 8  # the rest are corners and pupils
    assert error.max() < 70
    hard = np.abs(_render(scene, size=size) - mean).max(axis=2)
    assert error.mean() < hard.mean() / 4


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.25, 0.5, 0.85])
def test_smooth_edges_mix_colours_by_the_covered_share(shift):
    """A column across a stick's upper side: floor above, a line of 2/3 pixel, fill below."""
    pose = jnp.array([[0.0, shift / 128, 0.0]])
    scene = made_scene((), (), fingers=None, goal=(9, 9, 1, 1))._replace(pose=pose)
    column = _render(scene, robot="short", size=256, half_extent=1.0, antialias=True)[:, 128]
    top = 128 - (0.05 * 128 + shift)  # of the outline, in pixels from the picture's top
    edges = np.arange(257)
    below = [np.clip(edges - start, 0, None) for start in (top - 1 / 3, top + 1 / 3)]
    rim, fill = (np.diff(share)[:, None] for share in below)  # lower than either side of the line
    expected = 255 * (1 - rim) + (rim - fill) * look.GREY_RIM + fill * look.GREY
    np.testing.assert_allclose(column[:128], expected[:128], atol=0.51)


def test_smooth_and_hard_pictures_are_equal_away_from_edges():
    scene = made_scene(*random_arguments(41))
    hard, smooth = _render(scene), _render(scene, antialias=True)
    away = ~near_edge(hard)
    np.testing.assert_array_equal(hard[away], smooth[away])
    assert away.mean() > 0.8


# ---------------------------------------------------------------- colours, order, dashes


def test_a_dash_that_is_left_out_leaves_no_smooth_trace():
    """The bottom side is 103.9 pixels long; column 240 is where a sixth dash would begin."""
    scene = made_scene((), (), robot=NOWHERE, goal=(0.3 / 171.12, 0.0, 0.607, 0.7))
    row = _render(scene, antialias=True)[int((HALF + 0.35) * 171.12)]
    np.testing.assert_array_equal(row[240], row[235])  # in the gap
    assert (row[235] != row[225]).any()  # in the fifth dash


@pytest.mark.parametrize("antialias", [False, True])
def test_jit_equals_plain_and_vmap_equals_loop(antialias):
    options = {"size": 96, "antialias": antialias}
    several = [made_scene(*random_arguments(50 + i)) for i in range(3)]
    together = jax.tree.map(lambda *leaves: jnp.stack(leaves), *several)
    render = functools.partial(raster.render, **options)
    batch = np.asarray(jax.jit(jax.vmap(render))(together))
    for i, scene in enumerate(several):
        for other in (render(scene), _render(scene, **options)):
            difference = np.abs(np.asarray(other, int) - batch[i]).max(axis=2)
            assert (difference > 1).sum() <= 2  # rounding: pixels right at an edge
            assert (difference > 0).mean() < 0.01


def test_any_mix_of_shapes_and_colours_is_one_trace():
    render = functools.partial(raster.render, size=32)
    once = jax.jit(chex.assert_max_traces(lambda scene: render(scene), n=1))
    pictures = [np.asarray(once(made_scene(*random_arguments(60 + i)))) for i in range(3)]
    assert (pictures[0] != pictures[1]).any()


@pytest.mark.parametrize(("size", "antialias"), [(1, False), (2, True), (63, True), (385, False)])
def test_any_size_will_do(size, antialias):
    image = _render(made_scene(*demo_arguments()), size=size, antialias=antialias)
    assert image.shape == (size, size, 3)
    assert image.dtype == np.uint8


@pytest.mark.parametrize(("bad", "antialias"), [(np.nan, False), (np.inf, True)])
def test_a_pose_that_is_not_finite_hides_its_body(bad, antialias):
    names, blocks = demo_arguments()
    full = made_scene(names, blocks)
    for i in range(4):  # star, square, pentagon, circle
        hidden = full._replace(pose=full.pose.at[3 + i].set(bad))
        rest = [j for j in range(5) if j != i]
        without = made_scene([names[j] for j in rest], [blocks[j] for j in rest])
        np.testing.assert_array_equal(
            _render(hidden, size=64, antialias=antialias),
            _render(without, size=64, antialias=antialias),
            err_msg=names[i],
        )


def test_an_index_beyond_its_list_counts_as_the_nearest():
    scene = made_scene(*demo_arguments())
    last = scene._replace(shape=scene.shape.at[0].set(3), colour=scene.colour.at[0].set(3))
    beyond = scene._replace(shape=scene.shape.at[0].set(5), colour=scene.colour.at[0].set(6))
    np.testing.assert_array_equal(_render(last, size=64), _render(beyond, size=64))


# ---------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robot": "tentacle"}, "robot is 'tentacle', but must be one of gripper, short"),
        ({"robot": "long"}, r"long robot with 5 blocks needs \(6, 3\)"),
        ({"size": 0}, "size is 0"),
        ({"half_extent": 0.0}, "half_extent is 0.0, but must be a positive length"),
        ({"arena": math.inf}, "arena is inf"),
    ],
)
def test_options_that_do_not_fit_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        raster.render(made_scene(*demo_arguments()), **options)


def test_shapes_without_colours_are_refused():
    scene = made_scene(*demo_arguments())
    with pytest.raises(ValueError, match="5 shapes need as many colours, not 4"):
        raster.render(scene._replace(colour=scene.colour[:4]))
