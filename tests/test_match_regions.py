"""MatchRegions against its specification: poses, rewards, objects, observation and motion.

Reference numbers are those of the original simulator. One compiled step of 16 lanes serves the
whole file, because compiling it takes most of a test's time.
"""

import math

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scenes
from gril_jax.envs import match_regions
from gril_jax.envs import match_regions_layout as layouts

from gril_jax import envs

LANES = 16
OPEN = math.pi / 8
STAR, SQUARE, BLUE, CIRCLE, YELLOW = range(5)
NAMES = ("green star", "green square", "blue pentagon", "yellow circle", "yellow pentagon")
GOAL = np.array([0.40, 0.35])
CORNERS = [(0.9, 0.9, 0), (-0.9, 0.9, 0), (-0.9, -0.9, 0), (0.9, -0.9, 0), (0.92, 0.0, 0)]
LEFT, RIGHT = math.pi / 2, -math.pi / 2  # headings


@pytest.fixture(scope="module")
def env():
    return envs.make("match_regions")


@pytest.fixture(scope="module")
def step(env):
    """One control step of 16 lanes; fails if it is ever traced twice."""

    def lanes(state, action):
        return jax.vmap(env.step)(state, action)

    return jax.jit(chex.assert_max_traces(lanes, n=1))


@pytest.fixture(scope="module")
def demo(env):
    """16 lanes at the Demo reset."""
    return jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), LANES))


@pytest.fixture(scope="module")
def observe(env, demo):
    """States of 16 lanes from joint positions, perhaps velocities; distances as at reset."""
    function = jax.jit(jax.vmap(env._observe))

    def states(qpos, qvel=None):
        qvel = np.zeros_like(qpos) if qvel is None else qvel
        data = demo.data._replace(
            qpos=jnp.asarray(qpos, jnp.float32), qvel=jnp.asarray(qvel, jnp.float32)
        )
        return function(data)

    return states


@pytest.fixture(scope="module")
def at_demo(demo, observe):
    """A function of 16 dicts, each block -> (x, y[, angle]): the Demo layout but for these."""

    def states(changes):
        qpos = np.array(demo.data.qpos)
        for lane, moves in enumerate(changes):
            for block, pose in moves.items():
                qpos[lane, 5 + 3 * block : 5 + 3 * block + len(pose)] = pose
        return observe(qpos)

    return states


@pytest.fixture(scope="module")
def in_the_clear(observe):
    """A function of 16 (robot pose, dict of blocks): blocks in the corners but for these."""

    def states(scene):
        qpos = np.zeros((LANES, 20))
        qpos[:, 3:5] = OPEN, -OPEN
        for lane in range(LANES):
            robot, moves = scene.get(lane, ((0, 0, 0), {}))
            qpos[lane, :3] = robot
            for block, corner in enumerate(CORNERS):
                qpos[lane, 5 + 3 * block : 8 + 3 * block] = moves.get(block, corner)
        return observe(qpos)

    return states


@pytest.fixture(scope="module")
def play(step):
    """Joint positions (lanes, T + 1, 20) under actions (T, lanes, 3), and the last state."""

    def roll(state, actions):
        poses = [np.asarray(state.data.qpos)]
        for action in actions:
            state = step(state, jnp.asarray(action, jnp.float32))
            poses.append(np.asarray(state.data.qpos))
        return np.stack(poses, axis=1), state

    return roll


def _blocks(qpos):
    return qpos[..., 5:].reshape(*qpos.shape[:-1], 5, 3)


def _overhang(env, qpos):
    """How far each outline stands out of the arena: (lanes, robot and blocks)."""
    low, high = jax.vmap(env._extents)(jnp.asarray(qpos))
    centres = np.concatenate([qpos[:, None, :2], _blocks(qpos)[..., :2]], axis=1)
    return np.maximum(centres + high, -(centres + low)).max(axis=2) - env.arena


# ---------------------------------------------------------------- start and score


def test_demo_begins_at_the_reference_poses(demo):
    qpos = np.asarray(demo.data.qpos[0])
    np.testing.assert_allclose(qpos[:3], [-0.5, 0.1, -1.2 * math.pi], rtol=1e-6)
    np.testing.assert_allclose(qpos[3:5], [OPEN, -OPEN], rtol=1e-6)
    np.testing.assert_allclose(_blocks(qpos), [scenes.BLOCKS[n] for n in NAMES], rtol=1e-6)
    np.testing.assert_allclose(demo.data.goal[0], [*GOAL, 0.6, 0.7], rtol=1e-6)
    np.testing.assert_array_equal(demo.data.qvel, 0.0)
    assert (np.asarray(demo.data.qpos) == qpos).all()  # the same for every key


def test_demo_distances_are_the_references(demo):
    np.testing.assert_allclose(demo.data.start_distance[0], [1.1236, 1.1416], atol=1e-4)


def _half_way(block):
    return tuple((np.array(scenes.BLOCKS[NAMES[block]][:2]) + GOAL) / 2)


S4 = [  # what is moved where, reward, score
    ({}, -0.4996, 0.0),
    ({SQUARE: _half_way(SQUARE)}, 2.312, 0.0),
    ({SQUARE: GOAL}, 4.783, 0.5),
    ({STAR: GOAL}, 4.714, 0.5),
    ({STAR: (0.2, 0.2), SQUARE: (0.5, 0.5)}, 7.942, 1.0),
    ({STAR: (0.2, 0.2), SQUARE: (0.5, 0.5), BLUE: (0.5, 0.2)}, 5.246, 2 / 3),
    ({BLUE: GOAL}, -5.005, 0.0),
]


def test_dense_reward_has_the_references_values(at_demo):
    state = at_demo([moves for moves, *_ in S4])
    np.testing.assert_allclose(state.reward[: len(S4)], [r for _, r, _ in S4], atol=1e-3)
    np.testing.assert_allclose(state.metrics["score"][: len(S4)], [s for *_, s in S4], rtol=1e-6)


def test_robot_alone_changes_no_reward(demo, observe):
    qpos = np.array(demo.data.qpos)
    qpos[:, :2] = np.random.default_rng(0).uniform(-0.7, 0.7, (LANES, 2))
    np.testing.assert_allclose(observe(qpos).reward, demo.reward, rtol=1e-6)


def test_score_has_every_value_of_the_table(at_demo):
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


def test_inside_is_judged_by_the_centre_and_the_border_belongs_to_the_region(at_demo):
    changes = [
        {STAR: (0.101, 0.35)}, {STAR: (0.099, 0.35)},
        {STAR: (0.4, 0.699)}, {STAR: (0.4, 0.701)},
        {STAR: (0.699, 0.001)}, {STAR: (0.699, -0.001)}, {STAR: (0.701, 0.35)},
    ]  # fmt: skip
    score = at_demo(changes).metrics["score"][: len(changes)]
    assert score.tolist() == [0.5, 0, 0.5, 0, 0.5, 0, 0]


def test_the_task_itself_never_ends(demo, step):
    state = step(demo, jnp.ones((LANES, 3)))
    assert not demo.done.any()
    assert not state.done.any()


# ---------------------------------------------------------------- what is seen


def _random_qpos(seed):
    rng = np.random.default_rng(seed)
    qpos = rng.uniform(-0.9, 0.9, (LANES, 20))
    qpos[:, [2, *range(7, 20, 3)]] = rng.uniform(-4, 4, (LANES, 6))
    qpos[:, 3], qpos[:, 4] = rng.uniform(0, OPEN, LANES), rng.uniform(-OPEN, 0, LANES)
    return qpos, rng.normal(size=(LANES, 20))


def test_objects_come_as_region_robot_targets_distractors(env, demo):
    labels = [env.classes[i] for i in demo.objects.label[0]]
    assert labels == ["goal", "robot", *NAMES]
    assert demo.objects.is_robot[0].tolist() == [False, True, *[False] * 5]
    assert env.classes == match_regions.CLASSES


def test_boxes_of_blocks_are_those_of_their_turned_outlines(observe):
    qpos, _ = _random_qpos(1)
    objects = observe(qpos).objects
    for lane in range(LANES):
        for block, name in enumerate(NAMES):
            pose = _blocks(qpos)[lane, block]
            vertices = scenes.placed(scenes.corners(name.split()[1]), *pose)
            box = np.ptp(vertices, axis=0)
            # 2e-3: both circles have corners, the test's more
            np.testing.assert_allclose(objects.size[lane, 2 + block], box, atol=2e-3)
            np.testing.assert_allclose(objects.center[lane, 2 + block], pose[:2], atol=1e-6)


def test_boxes_of_region_and_robot_are_the_rectangle_and_the_disc(observe):
    qpos, _ = _random_qpos(2)
    objects = observe(qpos).objects
    np.testing.assert_allclose(objects.center[:, 0], [GOAL] * LANES, rtol=1e-6)
    np.testing.assert_allclose(objects.size[:, 0], [[0.6, 0.7]] * LANES, rtol=1e-6)
    np.testing.assert_allclose(objects.center[:, 1], qpos[:, :2], atol=1e-6)
    np.testing.assert_allclose(objects.size[:, 1], 0.4, rtol=1e-6)


def _expected_observation(qpos, qvel):
    """The module's table, number by number, in float64."""
    x, y, yaw, left, right = qpos[:5]
    ahead, side = (
        np.array([-math.sin(yaw), math.cos(yaw)]),
        np.array([math.cos(yaw), math.sin(yaw)]),
    )

    def in_robot_frame(point):
        offset = np.asarray(point) - [x, y]
        return [offset @ side, offset @ ahead]

    row = [x, y, math.cos(yaw), math.sin(yaw)]
    row += [qvel[:2] @ ahead, qvel[:2] @ side, qvel[2] / 2.5, (left - right) / (2 * OPEN)]
    row += [*in_robot_frame(GOAL), *GOAL, 0.6, 0.7]
    for (bx, by, angle), (vx, vy, spin) in zip(_blocks(qpos), _blocks(qvel), strict=True):
        within = abs(bx - GOAL[0]) <= 0.3 and abs(by - GOAL[1]) <= 0.35
        row += [*in_robot_frame((bx, by)), bx, by, bx - GOAL[0], by - GOAL[1], vx, vy]
        row += [math.cos(angle), math.sin(angle), spin / 10, float(within)]
    return row


def test_observation_is_what_the_docstring_says_index_by_index(env, observe):
    qpos, qvel = _random_qpos(3)
    obs = np.asarray(observe(qpos, qvel).obs)
    expected = np.array([_expected_observation(*row) for row in zip(qpos, qvel, strict=True)])
    assert obs.shape == expected.shape == (LANES, env.observation_size)
    np.testing.assert_allclose(obs, expected, atol=2e-6)
    assert 0 < expected[:, 14 + 11 :: 12].mean() < 1  # both inside and outside occur


# ---------------------------------------------------------------- free motion


FREE_STEPS = 22


@pytest.fixture(scope="module")
def driving(in_the_clear, play):
    """Per-step changes of joint positions, lane by lane: see the tests' names."""
    actions = np.zeros((FREE_STEPS, LANES, 3))
    actions[:, :, 2] = -1.0
    actions[:6, 0, 0] = 1.0
    actions[:6, 1, 1] = 1.0
    for lane, turn in enumerate((0.005, 0.01, 0.02, 0.04, 0.0625, 0.5), start=2):
        actions[:, lane, 1] = turn
    actions[:, 8, :2] = 1.0
    actions[:10, 9, 2] = 1.0
    actions[:6, 10, 0] = -1.0
    actions[:6, 11, 0] = 0.4
    actions[:, 12, 2] = 0.2
    scene = {lane: ((0, -0.5, 0), {}) for lane in range(LANES)}
    scene[8], scene[10] = ((0.3, 0, 0), {}), ((0, 0.5, 0), {})
    return play(in_the_clear(scene), actions)[0]


# MuJoCo sets velocities first and moves then, Chipmunk the other way round: where the speed
# changes, our displacements run half a substep (0.01 units, 0.03 rad) ahead of the reference.
AHEAD, TURNS_AHEAD = 0.012, 0.032


def test_full_speed_from_rest_takes_two_steps(driving):
    moved = np.diff(driving[0, :, 1])[:6]
    np.testing.assert_allclose(moved[:2], [0.0281, 0.0869], atol=AHEAD)
    np.testing.assert_allclose(moved[2:], 0.1, atol=1e-4)


def test_robot_stops_within_two_steps(driving):
    moved = np.diff(driving[0, :, 1])[6:]
    np.testing.assert_allclose(moved[:2], [0.0719, 0.0131], atol=AHEAD)
    np.testing.assert_allclose(moved[2:], 0.0, atol=1e-4)


def test_start_and_stop_together_cover_the_references_distance(driving):
    """What runs ahead at the start runs ahead at the stop: 6 steps at most end 0.470 away."""
    reference = 0.0281 + 0.0869 + 4 * 0.1 + 0.0719 + 0.0131
    assert np.ptp(driving[0, :, 1]) == pytest.approx(reference, abs=1e-3)


def test_reverse_mirrors_forward(driving):
    np.testing.assert_allclose(np.diff(driving[10, :, 1]), -np.diff(driving[0, :, 1]), atol=1e-4)


def test_speed_is_proportional_below_the_limit_and_robot_drives_straight(driving):
    np.testing.assert_allclose(np.diff(driving[11, :, 1])[1:6], 0.05, atol=1e-4)
    for lane in (0, 10, 11):
        np.testing.assert_allclose(driving[lane, :, [0, 2]], 0.0, atol=1e-4)


def test_full_turn_takes_one_step_to_build_up(driving):
    turned = np.diff(driving[1, :, 2])
    assert turned[0] == pytest.approx(0.195, abs=TURNS_AHEAD)
    np.testing.assert_allclose(turned[1:6], 0.3125, atol=1e-3)
    assert turned[6] == pytest.approx(0.119, abs=TURNS_AHEAD)
    np.testing.assert_allclose(turned[7:], 0.0, atol=1e-3)
    np.testing.assert_allclose(driving[1, :, :2], [[0, -0.5]] * (FREE_STEPS + 1), atol=1e-2)


@pytest.mark.parametrize(
    ("lane", "rate"), [(2, 0.025), (3, 0.05), (4, 0.10), (5, 0.20), (6, 0.3125), (7, 0.3125)]
)
def test_turning_is_linear_up_to_one_sixteenth_and_then_saturates(driving, lane, rate):
    np.testing.assert_allclose(np.diff(driving[lane, :, 2])[1:], rate, atol=1e-3)


def test_driving_while_turning_makes_the_references_circle(driving):
    x, y = driving[8, 6:, :2].T
    (a, b, c), *_ = np.linalg.lstsq(np.stack([2 * x, 2 * y, 1 + 0 * x], 1), x**2 + y**2, rcond=None)
    assert math.sqrt(c + a * a + b * b) == pytest.approx(0.318, abs=0.006)  # 0.8 / 2.5 = 0.32


def test_fingers_close_and_open_like_the_references(driving):
    left, right = driving[9, :, 3], driving[9, :, 4]
    np.testing.assert_allclose(left[1:6], [0.280, 0.155, 0.043, 0.009, 0.002], atol=0.013)
    opened = [0.113, 0.238, 0.350, 0.384, 0.391]
    np.testing.assert_allclose(left[11:16], opened, atol=0.013)
    np.testing.assert_allclose(right, -left, atol=1e-4)


def test_grip_is_graded_between_open_and_closed(driving):
    assert driving[12, -1, 3] == pytest.approx(OPEN - 0.2, abs=1e-3)


def test_smooth_turning_is_linear_over_the_whole_range(env):
    smooth = envs.make("match_regions", turn="smooth")
    qpos, qvel = jnp.zeros(20).at[3].set(OPEN), jnp.zeros(20)
    for turn in (0.02, 0.3, 1.0):
        gentle = smooth._drive(qpos, qvel, jnp.array([0.0, turn, 0.0]))
        original = env._drive(qpos, qvel, jnp.array([0.0, turn / 16, 0.0]))
        np.testing.assert_allclose(gentle, original, rtol=1e-6)


# ---------------------------------------------------------------- contacts


def _row(count):
    """Robot at the left, heading right, and this many blocks in a row before it."""
    order = (CIRCLE, SQUARE, BLUE, YELLOW, STAR)[:count]
    return (-0.85, -0.5, RIGHT), {b: (-0.55 + 0.25 * i, -0.5, 0) for i, b in enumerate(order)}


@pytest.fixture(scope="module")
def pushing(in_the_clear, play):
    """26 steps of full drive with open fingers, lane by lane: see the tests' names."""
    actions = np.zeros((26, LANES, 3))
    actions[:, :, 0], actions[:, :, 2] = 1.0, -1.0
    scene = {lane: _row(lane + 1) for lane in range(4)}
    scene[4] = ((-0.9, -0.5, RIGHT), {CIRCLE: (-0.4, -0.5, 0)})
    actions[8:, 4, 0] = -1.0
    scene[5] = ((-0.9, -0.5, RIGHT), {SQUARE: (-0.4, -0.5, 0)})
    actions[10:, 5, 0] = 0.0
    scene[6] = ((-0.9, -0.5, RIGHT), {SQUARE: (-0.45, -0.5, 0)})
    actions[:, 6] = [0.3, 0.0, -1.0]
    actions[3:12, 6, 2] = 1.0
    actions[12:, 6] = [-0.5, 0.0, 1.0]
    for block in range(5):  # into the wall, which is 0.5 away
        scene[7 + block] = ((0.0, -0.4, RIGHT), {block: (0.6, -0.4, 0.3 * block)})
    scene[12] = ((0.4, 0.5, LEFT + 0.5), {})  # robot alone into a wall, askew
    return play(in_the_clear(scene), actions)[0]


def test_robot_pushes_three_blocks_and_stalls_on_four(pushing):
    driven = pushing[:4, -1, 0] - pushing[:4, 0, 0]
    assert driven[0] > driven[1] > driven[2] > 1.0
    # In the original four blocks do not move at all; here they creep, an eighth of the speed.
    assert driven[3] < 0.35
    steps = np.diff(pushing[3, :, 0])
    assert steps[5:].max() < 0.0125


def test_pushed_blocks_go_as_fast_as_the_robot(pushing):
    circle = np.diff(_blocks(pushing[0])[:, CIRCLE, 0])
    robot = np.diff(pushing[0, :, 0])
    np.testing.assert_allclose(circle[6:12], robot[6:12], atol=2e-3)
    np.testing.assert_allclose(circle[6:12], 0.1, atol=5e-3)


def test_a_block_stays_where_the_robot_leaves_it(pushing):
    circle = _blocks(pushing[4])[:, CIRCLE, :2]
    assert circle[8, 0] - circle[0, 0] > 0.3  # pushed before
    assert np.linalg.norm(circle[10:] - circle[10], axis=1).max() < 1e-3


def test_a_block_stops_with_the_robot(pushing):
    square, robot = _blocks(pushing[5])[:, SQUARE, 0], pushing[5, :, 0]
    assert square[10] - square[0] > 0.5
    assert square[-1] - square[10] == pytest.approx(robot[-1] - robot[10], abs=2e-3)
    assert np.ptp(square[12:]) < 1e-3


def test_a_sliding_block_stops_within_one_step(in_the_clear, observe, play):
    qpos = np.array(in_the_clear({}).data.qpos)
    qvel = np.zeros_like(qpos)
    qvel[0, 5:7], qvel[1, 8], qvel[2, 7] = 0.8, -0.8, 10.0
    poses, state = play(observe(qpos, qvel), np.zeros((2, LANES, 3)))
    assert np.abs(poses[:, 1] - poses[:, 0])[:, 5:].max() < 0.011  # one substep at 0.8, or less
    np.testing.assert_allclose(state.data.qvel[:3, 5:], 0.0, atol=1e-4)


def test_gripped_block_is_dragged_backwards(pushing):
    square, robot = _blocks(pushing[6])[:, SQUARE, 0], pushing[6, :, 0]
    assert robot[12] - robot[20] > 0.3
    assert square[12] - square[20] > 0.9 * (robot[12] - robot[20])


def test_blocks_pushed_into_a_wall_stay_in_the_arena(env, pushing):
    for block in range(5):
        lane = pushing[7 + block]
        assert _blocks(lane)[-1, block, 0] > 0.85  # it got there
        assert _overhang(env, lane)[:, 1 + block].max() < 0.03
    assert _overhang(env, pushing[12])[:, 0].max() < 0.03


def test_nothing_breaks_under_random_and_extreme_actions(env, demo, step):
    rng = np.random.default_rng(0)
    extreme = [-1e30, -1e3, -1.0, 0.0, 1.0, 1e3, 1e30]
    state, worst, furthest = demo, 0.0, 0.0
    structure = jax.tree.structure(demo)
    for t in range(250):
        action = rng.uniform(-1, 1, (LANES, 3)) if t < 200 else rng.choice(extreme, (LANES, 3))
        state = step(state, jnp.asarray(action, jnp.float32))
        if t % 10 == 9:
            chex.assert_tree_all_finite(state)
            chex.assert_trees_all_equal_shapes_and_dtypes(state, demo)
            assert jax.tree.structure(state) == structure
            qpos = np.asarray(state.data.qpos)
            worst = max(worst, _overhang(env, qpos).max())
            furthest = max(furthest, np.abs(_blocks(qpos)[..., :2]).max())
    assert worst < 0.05
    assert furthest < env.arena
    moved = np.abs(np.asarray(state.data.qpos - demo.data.qpos))[:, 5:].max(axis=1)
    assert (moved > 0.1).mean() > 0.5  # the actions did reach blocks


def test_actions_beyond_the_box_act_like_its_border(demo, step):
    action = np.tile([7.0, -7.0, 7.0], (LANES, 1))
    a = step(demo, jnp.asarray(action, jnp.float32))
    b = step(demo, jnp.asarray(np.sign(action), jnp.float32))
    chex.assert_trees_all_equal(a, b)


def test_lanes_do_not_influence_each_other(demo, step):
    action = np.random.default_rng(1).uniform(-1, 1, (LANES, 3)).astype(np.float32)
    whole, mirrored = step(demo, jnp.asarray(action)), step(demo, jnp.asarray(action[::-1]))
    np.testing.assert_allclose(whole.data.qpos, mirrored.data.qpos[::-1], atol=1e-6)


# ---------------------------------------------------------------- starts


def _starts(count=200, **options):
    env = envs.make("match_regions", **options)
    keys = jax.random.split(jax.random.key(5), count)
    return env, jax.jit(jax.vmap(env.reset))(keys)


@pytest.fixture(scope="module")
def jittered():
    return _starts(variant="jitter")


@pytest.fixture(scope="module")
def scattered():
    return _starts(variant="layout")


def _clearances(env, state):
    """Gaps between bounding circles of robot and blocks (starts, 6, 6); inf on the diagonal."""
    qpos = np.asarray(state.data.qpos)
    centres = np.concatenate([qpos[:, None, :2], _blocks(qpos)[..., :2]], axis=1)
    outlines = [np.asarray(env.robot_outline(jnp.zeros(5).at[3].set(OPEN).at[4].set(-OPEN)))]
    outlines += [scenes.corners(name.split()[1]) for name in NAMES]
    radii = np.array([np.linalg.norm(o, axis=1).max() for o in outlines])
    apart = np.linalg.norm(centres[:, :, None] - centres[:, None], axis=-1)
    return apart - radii[:, None] - radii + np.diag([np.inf] * 6)


def test_jitter_moves_everything_a_little_and_within_its_bounds(demo, jittered):
    _, state = jittered
    poses = np.asarray(state.data.qpos)[:, [0, 1, 2, *range(5, 20)]].reshape(200, 6, 3)
    reference = np.asarray(demo.data.qpos[0])[[0, 1, 2, *range(5, 20)]].reshape(6, 3)
    moved = np.abs(poses - reference)
    bounds = np.array([0.0275, 0.0275, 0.157])
    assert (moved <= bounds + 1e-6).all()
    assert (moved.max(axis=0) > 0.9 * bounds).all()
    goal = np.abs(np.asarray(state.data.goal - demo.data.goal[0]))
    bounds = np.array([0.0275, 0.0275, 0.0075, 0.0075])
    assert (goal <= bounds + 1e-6).all()
    assert (goal.max(axis=0) > 0.9 * bounds).all()


def test_layouts_are_free_of_overlap_and_of_blocks_in_the_region(scattered):
    env, state = scattered
    assert _clearances(env, state).min() > 0
    assert _overhang(env, np.asarray(state.data.qpos)).max() < 1e-6
    assert not np.asarray(state.obs)[:, 14 + 11 :: 12].any()
    goal = np.asarray(state.data.goal)
    assert (np.abs(goal[:, :2]) + goal[:, 2:] / 2 <= env.arena + 1e-6).all()
    assert goal[:, 2:].min() >= 0.5
    assert goal[:, 2:].max() <= 0.8
    assert np.ptp(goal[:, 2:]) > 0.28


def test_layouts_reach_all_of_the_arena(scattered):
    _, state = scattered
    poses = _blocks(np.asarray(state.data.qpos))
    assert poses[..., :2].min(axis=(0, 1)).max() < -0.85
    assert poses[..., :2].max(axis=(0, 1)).min() > 0.85
    quadrant = (poses[..., 0] > 0) * 2 + (poses[..., 1] > 0)
    assert np.bincount(quadrant.ravel()).min() > 100  # of 1000
    assert np.ptp(poses[..., 2]) > 6


def test_reward_of_a_start_is_the_same_in_every_variant(demo, jittered, scattered):
    for _, state in (jittered, scattered):
        np.testing.assert_allclose(state.reward, demo.reward[0], atol=1e-4)


@pytest.fixture(scope="module", params=[0.5, 1.0])
def varied(request):
    return (request.param, *_starts(varied_starts=request.param))


def test_varied_starts_come_in_their_share_and_are_marked(varied):
    share, _, state = varied
    marked = np.asarray(state.data.varied)
    assert marked.mean() == pytest.approx(share, abs=0.1)
    np.testing.assert_array_equal(state.metrics["varied"], marked)
    placed = np.asarray(state.data.placed)
    assert (placed[marked == 0] == -1).all()
    assert (placed[marked == 1] >= 0).mean() == pytest.approx(2 / 3, abs=0.1)
    assert set(placed) == {-1, STAR, SQUARE}


def test_ordinary_starts_among_varied_ones_are_the_tasks_own(varied, demo):
    _, _, state = varied
    own = np.asarray(state.data.varied) == 0
    np.testing.assert_array_equal(state.data.qpos[own], demo.data.qpos[:1].repeat(own.sum(), 0))
    assert not state.moved[own].any()


def test_only_the_placed_block_counts_as_moved_and_is_in_the_region(varied):
    _, _, state = varied
    for i, placed in enumerate(np.asarray(state.data.placed)):
        expected = [False] * 7
        if placed >= 0:
            expected[2 + placed] = True
        assert state.moved[i].tolist() == expected
        assert (np.asarray(state.obs[i])[14 + 11 :: 12] > 0).tolist() == expected[2:]
        assert float(state.metrics["score"][i]) == (0.5 if placed >= 0 else 0.0)


def test_varied_starts_put_the_robot_anywhere_but_on_no_block(varied):
    _, env, state = varied
    gaps = _clearances(env, state)[np.asarray(state.data.varied) == 1]
    # The freest of 48 candidates may still graze a block's bounding circle, never the block.
    assert (gaps[:, 0] > 0).mean() > 0.95
    assert gaps[:, 0].min() > -0.1
    assert gaps[:, 1:, 1:].min() > 0
    robots = np.asarray(state.data.qpos)[:, :2]
    assert np.ptp(robots, axis=0).min() > 1.0  # as far as the blocks leave room
    assert _overhang(env, np.asarray(state.data.qpos)).max() < 1e-6


def test_reward_of_a_varied_start_is_that_of_the_same_scene_reached_from_the_demo_start(
    varied, demo, observe
):
    """It measures progress from the task's own start, so a target in place is worth as much."""
    _, _, state = varied
    first = np.asarray(state.data.qpos)[:LANES]
    np.testing.assert_allclose(observe(first).reward, state.reward[:LANES], rtol=1e-5)


# ---------------------------------------------------------------- the contract, any task


@pytest.fixture(params=envs.names())
def task(request):
    return envs.make(request.param)


def test_task_keeps_the_contract(task):
    assert isinstance(task, envs.Env)
    key, action = jax.random.key(0), jnp.zeros(task.action_size)
    first = jax.eval_shape(task.reset, key)
    after = jax.eval_shape(task.step, first, action)
    # Weak types too: one that changes would make a jitted step compile twice.
    assert jax.tree.leaves(first) == jax.tree.leaves(after)
    assert jax.tree.structure(first) == jax.tree.structure(after)
    assert all(not leaf.weak_type for leaf in jax.tree.leaves(after))
    assert first.obs.shape == (task.observation_size,)
    count = first.objects.label.shape[0]
    assert first.moved.shape == first.objects.is_robot.shape == (count,)
    assert first.objects.center.shape == first.objects.size.shape == (count, 2)
    assert {"score", "success"} <= set(first.metrics)
    assert task.episode_length > 0
    assert task.control_hz > 0
    assert task.half_extent > 0


def test_task_starts_where_its_key_says(task):
    reset = jax.jit(task.reset)
    a, b = reset(jax.random.key(3)), reset(jax.random.key(3))
    chex.assert_trees_all_equal(a, b)
    label = np.asarray(a.objects.label)
    assert label.min() >= 0
    assert label.max() < len(task.classes)
    assert int(a.objects.is_robot.sum()) == 1


def test_classes_are_the_detectors():
    from gril_jax.palette import PALETTE_CLASSES

    assert match_regions.CLASSES == PALETTE_CLASSES


# ---------------------------------------------------------------- options


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"variant": "demos"}, ["variant", "'demos'", "demo, jitter, layout"]),
        ({"turn": "fast"}, ["turn", "'fast'", "smooth"]),
        ({"targets": ("pink star",)}, ["'pink star'", "green star"]),
        ({"targets": ("goal",)}, ["'goal'"]),
        ({"distractors": ("red star",)}, ["'red star'", "demo layout"]),
        ({"distractors": ("red star",), "variant": "jitter"}, ["'red star'", "jitter layout"]),
    ],
)
def test_a_wrong_option_is_one_sentence_that_names_it(options, words):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        envs.make("match_regions", **options)
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_task_is_one_sentence_with_the_known_ones():
    with pytest.raises(ValueError, match=r"^task 'reach' is not one of match_regions$"):
        envs.make("reach")


def test_other_blocks_make_another_scene():
    env = envs.make(
        "match_regions",
        targets=("red circle",),
        distractors=("blue star", "green square"),
        variant="layout",
    )
    state = jax.eval_shape(env.reset, jax.random.key(0))
    assert env.blocks == ("red circle", "blue star", "green square")
    assert state.obs.shape == (14 + 36,)
    assert state.data.start_distance.shape == (1,)


def test_layout_constants_are_the_specifications():
    assert {name: layouts.DEMO_BLOCKS[name] for name in NAMES} == scenes.BLOCKS
