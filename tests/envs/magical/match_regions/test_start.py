"""Starts of MatchRegions: what each variant draws, and varied starts for training."""

import chex
import jax
import numpy as np
import pytest
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical.match_regions.task import MatchRegions
from support import match_regions_lanes as lanes
from support import planar_scenes, scenes
from support.match_regions_lanes import LANES, SQUARE, STAR, observe


@pytest.fixture(scope="module")
def demo():
    return lanes.demo()


@pytest.fixture(scope="module")
def jittered():
    return lanes.starts(variant="jitter")


@pytest.fixture(scope="module")
def scattered():
    return lanes.starts(variant="layout")


def _clearances(env, state):
    """Smallest gaps (starts, 2) from the robot's rim to a block's bounding circle, and between two
    such circles."""
    pose = np.asarray(state.data.pose)
    outlines = [scenes.corners(name.split()[1]) for name in env.blocks]
    radii = np.array([np.linalg.norm(o, axis=1).max() for o in outlines])
    blocks = pose[:, -len(radii) :, :2]
    apart = np.linalg.norm(blocks[:, :, None] - blocks[:, None], axis=-1) - radii[:, None] - radii
    apart += np.diag([np.inf] * len(radii))
    rim, gaps = layouts.rim(env.robot), []
    for base, places in zip(pose[:, 0], blocks, strict=True):
        points = planar_scenes.turned(rim, base[2]) + base[:2]
        away = np.linalg.norm(points[:, None] - places, axis=-1) - radii
        gaps.append(away.min())
    return np.stack([gaps, apart.min(axis=(1, 2))], axis=1)


def _overhang(env, state):
    return planar_scenes.overhang(env, np.asarray(state.data.pose, np.float64)).max()


def test_layouts_are_free_of_overlap_and_of_blocks_in_the_region(scattered):
    env, state = scattered
    assert not state.data.unplaced.any()
    assert _clearances(env, state).min() > -1e-3  # the layout's radii are rounded
    assert _overhang(env, state) < 1e-3
    assert not np.asarray(state.obs)[:, 14 + 11 :: 12].any()


def test_layouts_reach_all_of_the_arena(scattered):
    _, state = scattered
    poses = np.asarray(state.data.pose)[:, 3:]
    assert poses[..., :2].min(axis=(0, 1)).max() < -0.85
    assert poses[..., :2].max(axis=(0, 1)).min() > 0.85
    quadrant = (poses[..., 0] > 0) * 2 + (poses[..., 1] > 0)
    assert np.bincount(quadrant.ravel()).min() > 100  # of 1000
    assert np.ptp(poses[..., 2]) > 6


def test_reward_of_a_start_is_the_same_in_every_variant(demo, jittered, scattered):
    for _, state in (jittered, scattered):
        np.testing.assert_allclose(state.reward, demo.reward[0], atol=1e-4)


@pytest.fixture(scope="module", params=[(0.5, 0.0), (1.0, 0.5)])
def varied(request):
    share, on_the_way = request.param
    return (request.param, *lanes.starts(varied_starts=share, on_the_way=on_the_way))


def test_varied_starts_come_in_their_share_and_are_marked(varied):
    (share, on_the_way), _, state = varied
    marked = np.asarray(state.data.progress.varied)
    assert marked.mean() == pytest.approx(share, abs=0.1)
    np.testing.assert_array_equal(state.metrics["varied"], marked)
    moved = np.asarray(state.data.progress.moved)
    assert not moved[marked == 0].any()
    # Each is inside one time in three, and else on its way.
    expected = 1 / 3 + 2 / 3 * on_the_way
    assert moved[marked == 1][:, [STAR, SQUARE]].mean() == pytest.approx(expected, abs=0.1)
    assert not moved[:, 2:].any()


def test_ordinary_starts_among_varied_ones_are_the_tasks_own(varied, demo):
    _, _, state = varied
    own = np.asarray(state.data.progress.varied) == 0
    ours, theirs = state.data.pose[own], demo.data.pose[:1].repeat(own.sum(), 0)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    assert not state.moved[own].any()


def test_moved_targets_count_as_moved_and_are_in_the_region_or_on_their_way(varied, demo):
    (_, on_the_way), _, state = varied
    moved = np.asarray(state.data.progress.moved)
    assert not np.asarray(state.moved)[:, :2].any()
    np.testing.assert_array_equal(state.moved[:, 2:], moved)
    inside = np.asarray(state.obs)[:, 14 + 11 :: 12] > 0
    assert moved[inside].all()
    blocks = np.asarray(state.data.pose)[:, -moved.shape[1] :, :2]
    before = np.asarray(demo.data.pose)[0, -moved.shape[1] :, :2]
    stay = np.broadcast_to(before, blocks.shape)[~moved]
    np.testing.assert_allclose(blocks[~moved], stay, atol=1e-6)
    goal = np.asarray(state.data.regions)[..., :2]
    nearer = np.linalg.norm(blocks - goal, axis=2) < np.linalg.norm(before - goal, axis=2) + 0.3
    assert nearer[moved].all()
    score = np.asarray(state.metrics["score"])
    assert score[~moved.any(axis=1)].max() == 0
    if on_the_way:
        assert {0.0, 0.5, 1.0} == {*score[moved.any(axis=1)]}
        assert (score == 1).mean() < 0.3  # most still have something left to do
    else:
        np.testing.assert_array_equal(inside, moved)
        assert (score[moved.any(axis=1)] == 0.5).all()


def test_a_single_target_that_may_be_on_its_way_is_not_put_where_it_belongs():
    one = {"targets": ("green square",), "distractors": ("yellow circle",)}
    _, state = lanes.starts(**one, varied_starts=1.0, on_the_way=0.5)
    assert np.asarray(state.data.progress.moved)[:, 0].mean() == pytest.approx(0.5, abs=0.1)
    assert np.asarray(state.metrics["score"]).mean() < 0.25


def test_varied_starts_put_the_robot_anywhere_but_on_no_block(varied):
    _, env, state = varied
    assert not state.data.unplaced.any()
    assert _clearances(env, state)[np.asarray(state.data.progress.varied) == 1].min() > -1e-3
    robots = np.asarray(state.data.pose)[:, 0, :2]
    assert np.ptp(robots, axis=0).min() > 1.0  # as far as the blocks leave room
    assert _overhang(env, state) < 1e-3


def test_a_robot_that_faces_a_target_stands_right_before_one_that_is_not_in_the_region():
    env, state = lanes.starts(varied_starts=1.0, facing=1.0)
    pose = np.asarray(state.data.pose)
    robot, targets = pose[:, 0], pose[:, -5:-3, :2]
    forward = np.stack([-np.sin(robot[:, 2]), np.cos(robot[:, 2])], axis=1)
    offset = targets - robot[:, None, :2]
    distance = np.linalg.norm(offset, axis=2)
    ahead = np.einsum("nkd,nd->nk", offset, forward) > np.cos(0.45) * distance
    inside = np.asarray(state.obs)[:, 14 + 11 :: 12][:, :2] > 0
    before = ahead & (distance > 0.5) & (distance < 0.8) & ~inside
    assert before.any(axis=1).mean() > 0.9  # where there is room
    assert _clearances(env, state).min() > -1e-3
    assert _overhang(env, state) < 1e-3


def test_reward_of_a_varied_start_is_that_of_the_same_scene_reached_from_the_demo_start(
    varied, demo
):
    """It measures progress from the task's own start, so a target in place is worth as much."""
    _, _, state = varied
    first = np.asarray(state.data.pose)[:LANES]
    np.testing.assert_allclose(observe(first).reward, state.reward[:LANES], rtol=1e-5)


def test_variants_draw_what_their_names_say():
    def drawn(variant):
        state = lanes.starts(variant=variant)[1]
        chex.assert_tree_all_finite(state)
        data = state.data
        fields = (data.shape, data.colour, data.strengths, data.pose, data.regions)
        return [bool((np.ptp(np.asarray(f), axis=0) > 0).any()) for f in fields]

    assert {variant: drawn(variant) for variant in layouts.VARIANTS} == {
        "demo": [False, False, False, False, False],
        "jitter": [False, False, False, True, True],
        "layout": [False, False, False, True, True],
        "color": [False, True, False, False, False],
        "shape": [True, False, False, False, False],
        "dynamics": [False, False, True, False, False],
        "all": [True, True, True, True, True],
    }


@pytest.mark.parametrize(
    ("physics", "low", "high"), [("xmagical", 3.2, 5.5), ("magical", 2.2, 3.5)]
)
def test_drives_are_drawn_from_the_range_of_the_physics(physics, low, high):
    drive = np.asarray(lanes.starts(variant="dynamics", physics=physics)[1].data.strengths)[:, 0]
    assert low <= drive.min() < low + 0.1 * (high - low)
    assert high - 0.1 * (high - low) < drive.max() <= high


def test_boxes_of_a_scene_give_it_back_with_the_robot_free(jittered):
    """But for what boxes do not show: angles are drawn, and nothing moves or has been moved."""
    env, state = jittered
    keys = jax.random.split(jax.random.key(5), len(state.obs))
    placed = jax.jit(jax.vmap(env.place))(state.objects.center, state.objects.size, keys)
    chex.assert_trees_all_equal_shapes_and_dtypes(placed, state)
    np.testing.assert_allclose(placed.objects.center[:, [0, 2, 3, 4, 5, 6]],
                               state.objects.center[:, [0, 2, 3, 4, 5, 6]], atol=1e-6)  # fmt: skip
    np.testing.assert_allclose(placed.data.regions[:, 0], state.data.regions[:, 0], atol=1e-6)
    there = np.linalg.norm(placed.objects.center[:, 1] - state.objects.center[:, 1], axis=1) < 1e-6
    assert there.mean() > 0.9
    assert (_clearances(env, placed)[:, 0] > 0).all()
    assert not np.asarray(placed.data.velocity).any()
    assert np.ptp(np.asarray(placed.data.pose[:, -1, 2])) > 3
    np.testing.assert_array_equal(placed.metrics["score"], state.metrics["score"])
    np.testing.assert_array_equal(placed.data.colour, state.data.colour)


def test_forces_are_drawn_where_the_variant_draws_them():
    """Boxes do not show them."""

    def drawn(variant):
        env = MatchRegions(variant=variant)
        seen = env.reset(jax.random.key(0)).objects
        keys = jax.random.split(jax.random.key(1), 8)
        place = jax.vmap(lambda key: env.place(seen.center, seen.size, key).data.strengths)
        return np.ptp(np.asarray(jax.jit(place)(keys)), axis=0)

    assert (drawn("dynamics") > 0).all()
    assert (drawn("jitter") == 0).all()


def test_an_episode_of_the_long_stick_is_as_short_as_the_original_s():
    assert MatchRegions(robot="long").episode_length == 60
    assert MatchRegions(robot="long", episode_length=90).episode_length == 90
    assert MatchRegions(robot="short").episode_length == 120


def test_a_robot_that_holds_a_block_is_put_beside_it(jittered):
    env, state = jittered
    center = state.objects.center.at[:, 1].set(state.objects.center[:, 2])
    keys = jax.random.split(jax.random.key(0), len(center))
    placed = jax.jit(jax.vmap(env.place))(center, state.objects.size, keys)
    away = np.linalg.norm(placed.objects.center[:, 1] - center[:, 1], axis=1)
    assert away.min() > 0.1
    assert np.median(away) < 0.45  # the block of the task is in a corner
    assert (_clearances(env, placed)[:, 0] > 0).all()
