"""Readings of a MatchRegions scene: score, rewards, objects, observation.

Reference numbers are those of the original simulator.
"""

import math

import numpy as np
import pytest
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.magical.match_regions import task
from gril_jax.envs.planar.shapes import SHAPES
from support import match_regions_lanes as lanes
from support import planar_scenes, scenes
from support.match_regions_lanes import BLUE, GOAL, LANES, NAMES, SQUARE, STAR, at_demo, observe

OPEN = math.pi / 8


@pytest.fixture(scope="module")
def env():
    return lanes.task()


@pytest.fixture(scope="module")
def demo():
    return lanes.demo()


# ---------------------------------------------------------------- start and score


def test_demo_begins_at_the_reference_poses(demo):
    pose = np.asarray(demo.data.pose[0])
    robot = planar_scenes.parts("gripper", (-0.5, 0.1, -1.2 * math.pi))
    np.testing.assert_allclose(pose[:3], robot, rtol=1e-6)
    np.testing.assert_allclose(pose[3:], [scenes.BLOCKS[n] for n in NAMES], rtol=1e-6)
    np.testing.assert_allclose(demo.data.regions[0, 0], [*GOAL, 0.6, 0.7], rtol=1e-6)
    np.testing.assert_array_equal(demo.data.velocity, 0.0)
    np.testing.assert_array_equal(demo.data.memory, 0.0)
    assert (np.asarray(demo.data.pose) == pose).all()  # the same for every key
    assert not demo.data.unplaced.any()


def test_demo_distances_are_the_references(demo):
    np.testing.assert_allclose(demo.data.progress.start_distance[0], [1.1236, 1.1416], atol=1e-4)


def test_both_targets_inside_are_the_references_reward_and_a_success():
    state = at_demo([{STAR: (0.2, 0.2), SQUARE: (0.5, 0.5)}, {BLUE: GOAL}])
    np.testing.assert_allclose(state.reward[:2], [7.942, -5.005], atol=1e-3)
    assert state.metrics["success"][:2].tolist() == [1, 0]


def test_score_has_every_value_of_the_table():
    table = {
        (0, 0): 0, (0, 1): 0, (0, 2): 0, (0, 3): 0,
        (1, 3): 0.125, (1, 2): 1 / 6, (1, 1): 0.25, (1, 0): 0.5,
        (2, 3): 0.4, (2, 2): 0.5, (2, 1): 2 / 3, (2, 0): 1.0,
    }  # fmt: skip
    spots = [(0.2, 0.1), (0.6, 0.1), (0.2, 0.6), (0.6, 0.6), (0.4, 0.35)]
    changes = [
        {block: spots[block] for block in (*range(n_t), *range(2, 2 + n_d))} for n_t, n_d in table
    ]
    state = at_demo(changes)
    np.testing.assert_allclose(state.metrics["score"][:12], list(table.values()), rtol=1e-6)
    np.testing.assert_array_equal(
        state.metrics["success"][:12], [float(n == (2, 0)) for n in table]
    )


def test_inside_is_judged_by_the_centre_and_the_border_belongs_to_the_region():
    changes = [
        {STAR: (0.101, 0.35)}, {STAR: (0.099, 0.35)},
        {STAR: (0.4, 0.699)}, {STAR: (0.4, 0.701)},
        {STAR: (0.699, 0.001)}, {STAR: (0.699, -0.001)}, {STAR: (0.701, 0.35)},
    ]  # fmt: skip
    score = at_demo(changes).metrics["score"][: len(changes)]
    assert score.tolist() == [0.5, 0, 0.5, 0, 0.5, 0, 0]


# ---------------------------------------------------------------- what is seen


def _random_poses(seed):
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-0.9, -0.9, -4], [0.9, 0.9, 4], (LANES, 8, 3))
    for lane, opening in enumerate(rng.uniform(0, OPEN, LANES)):
        pose[lane, :3] = planar_scenes.parts("gripper", pose[lane, 0], opening)
    return pose, rng.normal(size=(LANES, 8, 3))


def test_objects_come_as_region_robot_targets_distractors(env, demo):
    labels = [env.classes[i] for i in demo.objects.label[0]]
    assert labels == ["goal", "robot", *NAMES]
    assert demo.objects.is_robot[0].tolist() == [False, True, *[False] * 5]
    assert env.classes == task.CLASSES


def test_boxes_of_blocks_are_those_of_their_turned_outlines():
    pose, _ = _random_poses(1)
    objects = observe(pose).objects
    for lane in range(LANES):
        for block, name in enumerate(NAMES):
            place = pose[lane, 3 + block]
            vertices = scenes.placed(scenes.corners(name.split()[1]), *place)
            box = np.ptp(vertices, axis=0)
            # 5e-3: the square's corners are rounded outwards by 0.0021
            np.testing.assert_allclose(objects.size[lane, 2 + block], box, atol=5e-3)
            np.testing.assert_allclose(objects.center[lane, 2 + block], place[:2], atol=1e-6)


def test_boxes_of_region_and_robot_are_the_rectangle_and_the_disc():
    pose, _ = _random_poses(2)
    objects = observe(pose).objects
    np.testing.assert_allclose(objects.center[:, 0], [GOAL] * LANES, rtol=1e-6)
    np.testing.assert_allclose(objects.size[:, 0], [[0.6, 0.7]] * LANES, rtol=1e-6)
    np.testing.assert_allclose(objects.center[:, 1], pose[:, 0, :2], atol=1e-6)
    np.testing.assert_allclose(objects.size[:, 1], 0.4, rtol=1e-6)


@pytest.mark.parametrize(("robot", "width"), [("short", 0.3), ("medium", 0.6), ("long", 1.6)])
def test_box_of_a_stick_is_that_of_its_turned_rectangle(robot, width):
    pose = np.stack([planar_scenes.scene(robot, (0.1, 0.0, 0.2 * k)) for k in range(LANES)])
    objects = planar_scenes.begin(pose, robot=robot).objects
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [width / 2, 0.05]
    boxes = [np.ptp(planar_scenes.turned(corners, 0.2 * k), axis=0) for k in range(LANES)]
    np.testing.assert_allclose(objects.size[:, 1], boxes, atol=1e-6)


def test_labels_are_those_of_drawn_colours_and_shapes():
    env, state = lanes.starts(variant="all")
    label = np.asarray(state.objects.label)
    colour, shape = np.asarray(state.data.colour), np.asarray(state.data.shape)
    for lane in range(60):
        names = [env.classes[i] for i in label[lane, 2:]]
        expected = [
            f"{COLOURS[c]} {SHAPES[s]}" for c, s in zip(colour[lane], shape[lane], strict=True)
        ]
        assert names == expected
