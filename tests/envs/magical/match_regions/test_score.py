"""Scores and dense rewards against the reference's values at known states, and against numpy."""

import math

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import make
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.magical.match_regions import score as rewards
from gril_jax.envs.magical.match_regions import task
from gril_jax.envs.magical.match_regions.score import REGION, ROBOT, stages
from gril_jax.envs.planar.shapes import SHAPES
from support import match_regions_lanes as lanes
from support import planar_scenes, scenes
from support.match_regions_lanes import BLUE, LANES, NAMES, SQUARE, STAR, at_demo, observe

HOME = np.array([scenes.BLOCKS[name][:2] for name in NAMES])
BASE, GOAL = np.array([-0.5, 0.1]), np.array([0.40, 0.35])
PAIR = {STAR: (0.25, 0.35), SQUARE: (0.55, 0.35)}


def _progress(moves):
    """The Demo scene but for these blocks, one step after the reset."""
    xy = HOME.copy()
    for block, place in moves.items():
        xy[block] = place
    start, first = (np.linalg.norm(HOME[:2] - p, axis=1) for p in (GOAL, BASE))
    now = np.linalg.norm(xy[:2] - BASE, axis=1)
    return rewards.ScoreInputs(
        inside=jnp.asarray((np.abs(xy - GOAL) <= [0.3, 0.35]).all(axis=1)),
        distance=jnp.asarray(np.linalg.norm(xy[:2] - GOAL, axis=1), jnp.float32),
        start=jnp.asarray(start, jnp.float32),
        nearest=jnp.asarray(np.minimum(now, first), jnp.float32),
    )


@pytest.mark.parametrize(
    ("moves", "sparse", "s4", "v5"),
    [
        ({}, 0, -0.4996, 1.228),
        ({SQUARE: tuple((HOME[SQUARE] + GOAL) / 2)}, 0, 2.312, 2.265),
        ({SQUARE: tuple(GOAL)}, 0.5, 4.783, 22.47),
        ({STAR: tuple(GOAL)}, 0.5, 4.714, 22.75),
        (PAIR, 1.0, 7.942, 33.47),
        (PAIR | {BLUE: (0.4, 0.1)}, 2 / 3, 5.246, 24.83),
        ({BLUE: tuple(GOAL)}, 0, -5.005, -7.78),
    ],
)
def test_rewards_have_the_references_values(moves, sparse, s4, v5):
    at = _progress(moves)
    assert float(rewards.reward("sparse", at)) == pytest.approx(sparse, rel=1e-6)
    assert float(rewards.reward("S4", at)) == pytest.approx(s4, abs=1e-3)
    assert float(rewards.reward("V5", at)) == pytest.approx(v5, abs=6e-3)


def _numpy(name, at):
    """The reference's formulas as loops in float64."""
    inside, distance, start, nearest = (np.asarray(f, np.float64) for f in at)
    count, diagonal = len(distance), 2 * np.sqrt(2)
    n_t, n_d = inside[:count].sum(), inside[count:].sum()
    share = n_d / (n_t + n_d) if n_t + n_d else 0.0
    outside = [i for i in range(count) if not inside[i]]
    left = [0.0 if inside[i] else distance[i] for i in range(count)]
    if name == "sparse":
        return n_t / count * (1 - share)
    if name == "S4":
        return 10 * np.tanh((-n_d + sum(start[i] - left[i] for i in range(count)) - 0.1) / 2)
    near = sum(max(0.0, 1 - nearest[i] / diagonal) for i in outside)
    whole = n_t / (n_t + n_d) if n_t + n_d else 0.0
    far = -10 * np.mean(distance / diagonal) * (1 + np.sqrt(share))
    return far + 4 + near + 10 * whole + 10 * n_t - 5 * n_d


def _random(seed, targets=2, blocks=5):
    rng = np.random.default_rng(seed)
    distance, start, reach = rng.uniform(0.05, 2.5, (3, targets)).astype(np.float32)
    return rewards.ScoreInputs(
        inside=jnp.asarray(rng.random(blocks) < 0.5),
        distance=jnp.asarray(distance),
        start=jnp.asarray(start),
        nearest=jnp.asarray(reach * rng.uniform(0.1, 1, targets).astype(np.float32)),
    )


@pytest.mark.parametrize("name", rewards.REWARDS)
@pytest.mark.parametrize(("targets", "blocks"), [(2, 5), (1, 1), (3, 3), (1, 4)])
def test_rewards_are_their_formulas(name, targets, blocks):
    for seed in range(20):
        at = _random(seed, targets, blocks)
        assert float(rewards.reward(name, at)) == pytest.approx(
            _numpy(name, at), rel=2e-4, abs=2e-4
        )


@pytest.mark.parametrize("name", rewards.REWARDS)
def test_jit_is_plain_and_vmap_is_a_loop(name):
    many = [_random(seed) for seed in range(6)]
    loop = [float(rewards.reward(name, at)) for at in many]
    stacked = jax.tree.map(lambda *f: jnp.stack(f), *many)
    lanes = jax.jit(jax.vmap(lambda at: rewards.reward(name, at)))(stacked)
    np.testing.assert_allclose(lanes, loop, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", rewards.REWARDS)
def test_a_target_at_the_very_centre_and_one_under_the_robot_are_finite(name):
    at = _progress({SQUARE: tuple(GOAL)})
    at = at._replace(nearest=jnp.zeros(2), distance=jnp.zeros(2))
    chex.assert_tree_all_finite(rewards.reward(name, at))


def test_best_of_s4_is_the_references():
    """Both targets inside and nothing else: no state of the Demo layout is worth more."""
    best = float(rewards.reward("S4", _progress(PAIR)))
    assert best == pytest.approx(7.94, abs=5e-3)
    rng = np.random.default_rng(0)
    for _ in range(50):
        moves = {block: tuple(rng.uniform(-1, 1, 2)) for block in range(5)}
        assert float(rewards.reward("S4", _progress(moves))) <= best + 1e-5


# --- Readings of a MatchRegions scene: score, rewards, objects, observation

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
    state = at_demo([{STAR: (0.2, 0.2), SQUARE: (0.5, 0.5)}, {BLUE: tuple(GOAL)}])
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


# --- MatchRegions' stages agree with the task's own score

TASK = stages(("green star", "green square", "blue pentagon"), 2, arena=1.1)
SIZE = jnp.array([[0.6, 0.7], [0.4, 0.4], [0.3, 0.3], [0.27, 0.29], [0.26, 0.26]])
START = jnp.array([[0.4, 0.35], [-0.5, 0.1], [0.8, -0.7], [-0.68, 0.72], [-0.05, -0.2]])


def _score(center, size, targets):
    inside = [all(abs(c - center[0]) <= size[0] / 2) for c in center[2:]]
    right, wrong = sum(inside[:targets]), sum(inside[targets:])
    return right / targets * (1 - wrong / max(right + wrong, 1))


def test_progress_is_the_tasks_score():
    rng = np.random.default_rng(0)
    center = rng.uniform(-0.9, 0.9, (200, 5, 2)).astype(np.float32)
    center[:, 0] = START[0]
    center[::2, 2:] = np.float32(START[0]) + 0.5 * center[::2, 2:]
    found = jax.vmap(lambda c: TASK.progress(c, SIZE))(jnp.asarray(center))
    wanted = [_score(c, np.asarray(SIZE), 2) for c in center]
    assert len(set(np.round(wanted, 3))) > 4
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_blocks_are_put_wholly_inside_and_clear_of_each_other():
    def both(key):
        keys = jax.random.split(key)
        center = TASK.stages[0].place(keys[0], START, SIZE)
        return TASK.stages[1].place(keys[1], center, SIZE)

    center = jax.vmap(both)(jax.random.split(jax.random.key(0), 40))
    for block in (2, 3):
        reach = jnp.abs(center[:, block] - START[REGION]) + SIZE[block] / 2
        assert (reach <= SIZE[REGION] / 2 + 1e-6).all()
    apart = jnp.linalg.norm(center[:, 2] - center[:, 3], axis=1)
    assert jnp.mean(apart > 0.28) > 0.8
    rest = jnp.array([0, 1, 4])
    np.testing.assert_array_equal(center[:, rest], jnp.tile(START[rest], (40, 1, 1)))


def test_a_region_smaller_than_the_block_gets_it_at_its_centre():
    small = SIZE.at[REGION].set(0.1)
    center = TASK.stages[0].place(jax.random.key(0), START, small)
    np.testing.assert_allclose(center[2], START[REGION], atol=1e-6)
    assert TASK.done(center, small).tolist() == [True, False]


def test_the_environment_offers_them_in_the_order_of_its_objects():
    env = make("match_regions", targets=("green square",), distractors=("yellow circle",))
    assert [s.name for s in env.stages.stages] == ["green square in the region"]
    assert [s.name for s in env.stages.faults] == ["yellow circle in the region"]
    assert (env.stages.movable, env.stages.robots) == ((2, 3), (ROBOT,))
    assert env.stages.half_extent == env.arena
