"""Sampled starts of episodes: bounds, shares, no overlap, and a flag where nothing fits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical.match_regions import start as starts
from gril_jax.envs.magical.suite import places, plan
from gril_jax.envs.planar import robots
from gril_jax.envs.planar import shapes as block_shapes
from support import planar_scenes, scenes

ARENA = 1.1


def _keys(count=300, seed=0):
    return jax.random.split(jax.random.key(seed), count)


# ---------------------------------------------------------------- colours, shapes, forces


def _drawn_colours(colour, targets):
    draw = jax.jit(jax.vmap(lambda k: layouts.colours(k, jnp.array(colour), targets)))
    return np.asarray(draw(_keys()))


def test_color_gives_targets_one_colour_and_distractors_the_others():
    colour = _drawn_colours([0, 0, 1, 2, 2], 2)
    assert (colour[:, 0] == colour[:, 1]).all()
    assert (colour[:, 3] == colour[:, 4]).all()
    assert (colour[:, 2] != colour[:, 3]).all()
    assert (colour[:, :1] != colour[:, 2:]).all()
    np.testing.assert_allclose(np.bincount(colour[:, 0], minlength=4) / 300, 0.25, atol=0.08)


def test_color_keeps_the_order_of_the_distractors_colours():
    """The three colours that are left, in the list's order, for blue, yellow and red."""
    for row in _drawn_colours([0, 1, 2, 3], 1):
        assert row[1:].tolist() == sorted(set(range(4)) - {row[0]})


def test_shapes_are_any_of_the_four_for_every_block():
    drawn = np.asarray(jax.jit(jax.vmap(lambda k: plan.shapes(k, 5)))(_keys()))
    for block in drawn.T:
        np.testing.assert_allclose(np.bincount(block, minlength=4) / 300, 0.25, atol=0.08)


def test_dynamics_are_uniform_in_the_references_ranges():
    drawn = jax.jit(jax.vmap(layouts.dynamics))(_keys(1000))
    ranges = [(3.2, 5.5), (0.7, 1.5), (2.5, 4.5), (1.0, 1.8), (0.07, 0.15)]
    for values, (low, high) in zip(drawn, ranges, strict=True):
        share = (np.asarray(values) - low) / (high - low)
        assert -1e-5 <= share.min() < 0.02
        assert 0.98 < share.max() <= 1 + 1e-5
        assert share.mean() == pytest.approx(0.5, abs=0.05)
    assert abs(np.corrcoef(np.asarray(drawn.drive), np.asarray(drawn.table))[0, 1]) < 0.1


def test_radii_are_those_of_the_outlines():
    radii = [np.linalg.norm(scenes.corners(s), axis=1).max() for s in block_shapes.SHAPES]
    # The square's corners are rounded outwards by 0.0021.
    np.testing.assert_allclose(layouts.RADII, radii, atol=2.5e-3)
    assert (layouts.RADII >= np.array(radii) - 1e-6).all()


# ---------------------------------------------------------------- places


def _scatter(robot, shapes, count=100, arena=ARENA):
    radii = jnp.asarray(layouts.RADII[list(shapes)] if shapes else np.zeros(0, np.float32))
    draw = lambda k: layouts.scatter(k, robots.robot(robot), radii, arena=arena)  # noqa: E731
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(draw))(_keys(count)))


def _overlaps(robot, layout, shapes):
    """True for starts in which two of robot, blocks and region overlap, or a wall is crossed."""
    rim, radii = layouts.rim(robots.robot(robot)), layouts.RADII[list(shapes)] - 1e-5
    found = []
    for base, blocks, goal in zip(layout.robot, layout.blocks, layout.regions[:, 0], strict=True):
        points = planar_scenes.turned(rim, base[2]) + base[:2]
        away = np.linalg.norm(points[:, None] - blocks[:, :2], axis=-1) < radii
        apart = np.linalg.norm(blocks[:, None, :2] - blocks[:, :2], axis=-1)
        pairs = (apart < radii[:, None] + radii) & ~np.eye(len(radii), dtype=bool)
        beyond = np.abs(blocks[:, :2] - goal[:2]) - goal[2:] / 2
        on_goal = np.linalg.norm(np.maximum(beyond, 0), axis=1) < radii
        robot_on_goal = (np.abs(points - goal[:2]) < goal[2:] / 2 - 1e-5).all(axis=1)
        out = np.abs(points).max() > ARENA + 1e-5
        out |= (np.abs(blocks[:, :2]) + radii[:, None] > ARENA).any()
        found.append(away.any() | pairs.any() | on_goal.any() | robot_on_goal.any() | out)
    return np.array(found)


@pytest.mark.parametrize("robot", robots.ROBOTS)
def test_scattered_starts_are_free_of_overlap_or_say_so(robot):
    shapes = (0, 1, 2, 3, 2)
    layout = _scatter(robot, shapes)
    overlaps = _overlaps(robot, layout, shapes)
    assert not overlaps[~layout.unplaced].any()
    assert layout.unplaced.mean() < 0.05


def test_regions_have_the_references_sizes_and_lie_in_the_arena():
    goal = _scatter("gripper", (3,)).regions[:, 0]
    assert goal[:, 2:].min() >= 0.5
    assert goal[:, 2:].max() <= 0.8
    assert (np.abs(goal[:, :2]) + goal[:, 2:] / 2 <= ARENA + 1e-6).all()


def test_more_blocks_than_fit_are_flagged():
    layout = _scatter("short", (0,) * 12, count=8, arena=0.6)  # circles of 0.92 in 1.44
    assert layout.unplaced.all()
    assert np.isfinite(layout.blocks).all()


def test_a_robot_that_cannot_stand_anywhere_is_flagged():
    layout = _scatter("long", (3,), count=8, arena=0.7)
    assert layout.unplaced.all()


def test_no_blocks_at_all_is_a_layout_too():
    layout = _scatter("short", ())
    assert layout.blocks.shape == (100, 0, 3)
    assert not layout.unplaced.any()


def test_place_robot_without_a_region_may_stand_where_one_is():
    radii, blocks = jnp.asarray(layouts.RADII[:1]), jnp.array([[0.9, 0.9, 0.0]])
    robot, goal = robots.robot("short"), jnp.array([0.0, 0.0, 1.6, 1.6])

    def draw(goal):
        place = lambda k: layouts.place_robot(k, robot, blocks, radii, goal, arena=ARENA)  # noqa: E731
        pose, unplaced = jax.jit(jax.vmap(place))(_keys(100))
        return np.abs(np.asarray(pose)[:, :2]).max(axis=1), np.asarray(unplaced)

    anywhere, unplaced = draw(None)
    assert not unplaced.any()
    assert (anywhere < 0.7).mean() > 0.2
    outside, unplaced = draw(goal)
    assert outside[~unplaced].min() > 0.8


@pytest.mark.parametrize("robot", robots.ROBOTS)
def test_rim_goes_all_around_the_robot_in_small_steps(robot):
    made = robots.robot(robot)
    rim = layouts.rim(made)
    pose = planar_scenes.parts(robot, (0, 0, 0))
    for part, (x, y, angle) in zip(made.parts, pose, strict=True):
        outline = planar_scenes.turned(part.outline, angle) + [x, y]
        share = np.linspace(0, 1, 50)[:, None, None]
        dense = (outline + (np.roll(outline, -1, axis=0) - outline) * share).reshape(-1, 2)
        gaps = np.linalg.norm(dense[:, None] - rim, axis=-1).min(axis=1)
        assert gaps.max() < 0.016


# ---------------------------------------------------------------- jitter


def test_jitter_stays_within_its_bounds():
    demo = places.demo(starts.DEMO, len(starts.DEMO.blocks))
    moved = jax.jit(jax.vmap(lambda k: layouts.jitter(k, demo, arena=ARENA)))(_keys())
    off = np.abs(np.asarray(moved.blocks) - np.asarray(demo.blocks))
    assert (off <= np.array([0.0275, 0.0275, 0.157]) + 1e-6).all()
    assert (off.max(axis=0) > 0.9 * np.array([0.0275, 0.0275, 0.157])).all()
    off = np.abs(np.asarray(moved.regions - demo.regions)[:, 0])
    assert (off <= np.array([0.0275, 0.0275, 0.0075, 0.0075]) + 1e-6).all()
    assert not np.asarray(moved.unplaced).any()


@pytest.mark.parametrize("good", [(), (0,), (3,), (7, 8), (8,), (5, 40), (63,)])
def test_the_first_free_pose_is_found_a_few_at_a_time(good):
    """As by a look at all of them at once; alone and in a batch."""
    poses = jnp.arange(1.0, 65.0)[:, None] * jnp.ones(3)
    free = lambda few: jnp.isin(few[:, 0], 1.0 + jnp.array(good))  # noqa: E731
    pose, found = jax.jit(lambda: layouts.first_free(poses, free))()
    assert found == bool(good)
    np.testing.assert_array_equal(pose, poses[min(good, default=0)])
    each = jax.vmap(lambda wanted: layouts.first_free(poses, free, wanted=wanted))
    batch, both = each(jnp.array([False, True]))
    np.testing.assert_array_equal(batch, [poses[0], pose])
    np.testing.assert_array_equal(both, [False, found])
