"""Starts at frames of films in the variants: as one of their draws might have looked."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.suite import from_boxes
from gril_jax.envs.planar.shapes import NOTHING, SHAPES

from gril_jax import envs
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.workflows.build import policy_rewards

TASKS = ("find_dupe", "make_line", "cluster_shape")  # with a region, without one, with spare slots
ARENA = 1.0


@functools.cache
def _task(name, variant):
    return envs.make(name, engine="impulse", variant=variant, padded=True)


@functools.cache
def _frames(name):
    """Boxes of starts near Demo's, and of the task nearly or wholly done."""
    env = _task(name, "demo")
    starts = jax.jit(jax.vmap(_task(name, "jitter").reset))(jax.random.split(jax.random.key(0), 8))
    center, size = np.array(starts.objects.center), np.asarray(starts.objects.size)
    blocks = [i for i, what in enumerate(env.object_names) if what.split()[-1] in SHAPES]
    if name == "find_dupe":  # each block in turn, in the region
        for frame, block in zip(range(1, 8), blocks, strict=True):
            center[frame, block] = center[frame, 1] + [0.05, -0.05]
    if name == "make_line":  # three of four, or all
        line = np.array([[0.4, 0.3], [0.4, 0.0], [0.4, -0.3], [0.4, -0.6]])
        for frame in range(4, 8):
            center[frame, blocks[: 3 + frame % 2]] = line[: 3 + frame % 2]
    if name == "cluster_shape":  # in the order of their shapes, a heap in each corner
        sort = [SHAPES.index(env.object_names[i].split()[-1]) for i in blocks]
        heap = np.array([[0.6, 0.6], [-0.6, 0.6], [0.6, -0.6], [-0.6, -0.6]])
        place = [heap[kind] + 0.13 * (sort[:i].count(kind) - 0.5) for i, kind in enumerate(sort)]
        center[4:, blocks] = place
    return jnp.asarray(center), jnp.asarray(size)


def _placed(name, variant):
    center, size = _frames(name)
    keys = jax.random.split(jax.random.key(1), len(center))
    return jax.jit(jax.vmap(_task(name, variant).place))(center, size, keys)


@pytest.mark.parametrize("name", TASKS)
def test_a_frame_is_worth_the_same_in_every_variant(name):
    shown = np.asarray(_placed(name, "demo").metrics["score"])
    assert shown.min() < 0.1
    assert shown.max() == 1
    for variant in ("color", "all"):
        np.testing.assert_allclose(_placed(name, variant).metrics["score"], shown, atol=1e-6)


@pytest.mark.parametrize("name", TASKS)
def test_things_lie_where_demo_has_them_unless_the_variant_puts_them_anywhere(name):
    center, _ = _frames(name)
    there = np.asarray(_placed(name, "demo").objects.size).any(axis=-1)
    there[:, 0] = False  # a robot gives way to a block
    for variant in ("demo", "color", "shape"):
        seen = np.asarray(_placed(name, variant).objects.center)
        np.testing.assert_allclose(seen[there], np.asarray(center)[there], atol=1e-5)
    assert np.abs(np.asarray(_placed(name, "all").objects.center)[there] - center[there]).max() > 1


@pytest.mark.parametrize("name", TASKS)
def test_missing_blocks_stay_outside_and_all_else_within_the_walls(name):
    placed = _placed(name, "all")
    data, env = placed.data, _task(name, "all")
    blocks = data.pose[:, env._parts : env._parts + data.shape.shape[1], :2]
    there = np.asarray(data.shape) != NOTHING
    assert (there.sum(axis=1) == len(env.plan.blocks)).all()
    assert (np.abs(np.asarray(blocks)[there]) < ARENA).all()
    assert (np.asarray(blocks)[~there][:, 0] == 2).all()


def test_what_was_alike_still_is_and_what_was_not_is_not():
    kinds = jax.tree.map(jnp.asarray, _task("cluster_shape", "all")._kinds)
    drawn = jax.vmap(lambda k: from_boxes.renamed(k, kinds, colours=True, shapes=True))(
        jax.random.split(jax.random.key(0), 200)
    )
    there = np.asarray(kinds.shape) != NOTHING
    for before, after in ((kinds.colour, drawn.colour), (kinds.shape, drawn.shape)):
        before, after = np.asarray(before)[there], np.asarray(after)[:, there]
        alike = before[:, None] == before
        assert (alike == (after[:, :, None] == after[:, None])).all()
        assert len(np.unique(after[:, 0])) == 4  # every name is drawn
    assert (np.asarray(drawn.shape)[:, ~there] == NOTHING).all()
    same = from_boxes.renamed(jax.random.key(0), kinds, colours=False, shapes=False)
    jax.tree.map(np.testing.assert_array_equal, same, kinds)


def test_a_scene_moves_as_one_and_over_all_the_room_there_is():
    boxes = jnp.array([[0.5, 0.2, 0.2, 0.1], [-0.3, -0.4, 0.4, 0.6], [2.0, -1.0, 0.1, 0.1]])
    there = jnp.array([True, True, False])
    draw = jax.vmap(lambda k: from_boxes.moved(k, boxes, there, arena=ARENA))
    found = np.asarray(draw(jax.random.split(jax.random.key(0), 4000)))[:, :2]
    apart = np.linalg.norm(found[:, 0, :2] - found[:, 1, :2], axis=1)
    np.testing.assert_allclose(apart, 1.0, atol=1e-5)
    low = (found[..., :2] - found[..., 2:] / 2).min(axis=1)
    high = (found[..., :2] + found[..., 2:] / 2).max(axis=1)
    assert low.min() >= -ARENA - 1e-5
    assert high.max() <= ARENA + 1e-5
    assert low.min() < -0.99
    assert high.max() > 0.99
    # A quarter turn exchanges width and height; each of the eight ways to lie is as frequent.
    way = np.sign(found[:, 0, :2] - found[:, 1, :2]), found[:, 0, 2] > found[:, 0, 3]
    ways = np.unique(np.column_stack([*way[0].T, way[1]]), axis=0, return_counts=True)[1]
    assert len(ways) == 8
    assert (np.abs(ways - 500) < 100).all()


def test_a_scene_that_has_no_room_stays_where_it_is():
    boxes = jnp.array([[0.0, 0.0, 2.2, 2.2]])
    found = from_boxes.moved(jax.random.key(3), boxes, jnp.array([True]), arena=ARENA)
    np.testing.assert_allclose(found, boxes, atol=1e-6)


def test_films_are_read_in_demos_classes_whatever_a_variant_draws():
    def labels(variant):
        env = {"name": "cluster_shape", "options": ("padded=True",), "observation": "plain"}
        config = RunConfig(env=EnvConfig(**env, varied_starts=0.0, variant=variant))
        return policy_rewards._labels(config)

    for variant in ("color", "shape", "all"):
        jax.tree.map(np.testing.assert_array_equal, labels(variant), labels("demo"))
