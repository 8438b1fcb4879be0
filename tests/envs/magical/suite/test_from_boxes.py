"""Starts at frames of videos, in the variants as one of their draws might have looked, and states
that follow a video's boxes."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.suite import places
from gril_jax.envs.planar.shapes import NOTHING, SHAPES

from gril_jax import envs
from gril_jax.config import EnvConfig, RunConfig
from gril_jax.types import DemoBatch
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


@functools.cache
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
    drawn = jax.vmap(lambda k: places.renamed(k, kinds, colours=True, shapes=True))(
        jax.random.split(jax.random.key(0), 200)
    )
    there = np.asarray(kinds.shape) != NOTHING
    for before, after in ((kinds.colour, drawn.colour), (kinds.shape, drawn.shape)):
        before, after = np.asarray(before)[there], np.asarray(after)[:, there]
        alike = before[:, None] == before
        assert (alike == (after[:, :, None] == after[:, None])).all()
        assert len(np.unique(after[:, 0])) == 4  # every name is drawn
    assert (np.asarray(drawn.shape)[:, ~there] == NOTHING).all()
    same = places.renamed(jax.random.key(0), kinds, colours=False, shapes=False)
    jax.tree.map(np.testing.assert_array_equal, same, kinds)


def test_a_scene_moves_as_one_and_over_all_the_room_there_is():
    boxes = jnp.array([[0.5, 0.2, 0.2, 0.1], [-0.3, -0.4, 0.4, 0.6], [2.0, -1.0, 0.1, 0.1]])
    there = jnp.array([True, True, False])
    draw = jax.vmap(lambda k: places.moved(k, boxes, there, arena=ARENA))
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
    found = places.moved(jax.random.key(3), boxes, jnp.array([True]), arena=ARENA)
    np.testing.assert_allclose(found, boxes, atol=1e-6)


def test_films_are_read_in_demos_classes_whatever_a_variant_draws():
    def labels(variant):
        env = {"name": "cluster_shape", "options": ("padded=True",), "observation": "plain"}
        config = RunConfig(env=EnvConfig(**env, varied_starts=0.0, variant=variant))
        return policy_rewards._labels(config)

    for variant in ("color", "shape", "all"):
        jax.tree.map(np.testing.assert_array_equal, labels(variant), labels("demo"))


# ---------------------------------------------------------------- states that follow boxes

PLACED = ("move_to_region", "fix_colour", "make_line")  # without blocks, with regions, without them


@functools.cache
def _begun(name):
    env = envs.make(name, engine="impulse")
    return env, jax.jit(env.reset)(jax.random.key(0))


@pytest.mark.parametrize("name", PLACED)
def test_a_start_has_everything_where_its_box_lies(name):
    env, state = _begun(name)
    seen = state.objects
    placed = jax.jit(env.place)(seen.center, seen.size, jax.random.key(1))
    np.testing.assert_allclose(placed.objects.center, seen.center, atol=1e-3)
    np.testing.assert_array_equal(placed.objects.label, seen.label)
    assert jax.tree.map(jnp.shape, placed) == jax.tree.map(jnp.shape, state)
    assert not placed.data.velocity.any()


@pytest.mark.parametrize("name", PLACED)
def test_a_shifted_state_follows_boxes_and_keeps_its_angles(name):
    env, state = _begun(name)
    moving = jnp.asarray([not c.endswith("region") for c in env.object_names])
    center = state.objects.center + jnp.where(moving[:, None], 0.05, 0.0)
    moved = jax.jit(env.shifted)(state, center)
    np.testing.assert_allclose(moved.objects.center, center, atol=1e-5)
    np.testing.assert_array_equal(moved.data.pose[:, 2], state.data.pose[:, 2])


def test_a_robot_that_is_all_that_moves_counts_as_an_object():
    assert not _begun("move_to_region")[1].objects.is_robot.any()
    assert _begun("make_line")[1].objects.is_robot.tolist() == [True, False, False, False, False]


def test_padded_variants_have_observations_of_one_size_and_nothing_where_nothing_is():
    plain = jax.jit(envs.make("cluster_shape", engine="impulse").reset)(jax.random.key(0))
    sizes = set()
    for variant in ("demo", "shape", "all"):
        env = envs.make("cluster_shape", engine="impulse", variant=variant, padded=True)
        state = jax.jit(env.reset)(jax.random.key(0))
        sizes.add((env.observation_size, state.obs.shape, state.objects.label.shape))
        if variant == "demo":
            np.testing.assert_array_equal(state.obs[: len(plain.obs)], plain.obs)
            assert not state.obs[len(plain.obs) :].any()
            there = np.asarray(state.objects.size).any(axis=1)
            assert there.sum() == len(plain.objects.label)
            np.testing.assert_array_equal(state.objects.center[there], plain.objects.center)
    assert len(sizes) == 1


def test_frames_of_films_leave_the_places_free_that_only_variants_fill():
    env = {"name": "cluster_shape", "options": ("padded=True",), "observation": "plain"}
    config = RunConfig(env=EnvConfig(**env, varied_starts=0.0))
    seen = jax.jit(envs.make("cluster_shape", engine="impulse").reset)(jax.random.key(0)).objects
    film = lambda x: jnp.asarray(x)[None, None].repeat(3, axis=1)  # noqa: E731
    demos = DemoBatch(
        film(seen.center), film(seen.size), seen.label[None], seen.is_robot[None],
        jnp.ones((1, len(seen.label)), bool), jnp.array([3]),
    )  # fmt: skip
    found = policy_rewards._frames(config, demos)
    there = np.asarray(found.size[0]).any(axis=1)
    assert (len(there), there.sum()) == (11, 9)
    np.testing.assert_array_equal(np.asarray(found.center[0])[there], seen.center)
    assert not np.asarray(found.active)[:, ~there].any()
    assert (np.asarray(found.center)[:, ~there] == 2).all()
