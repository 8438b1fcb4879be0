"""Motion of robots and blocks against the original simulator's measured responses.

Reference numbers are those of the original, whose solver makes 10 sweeps; the task's default of 6
is held against 10. Sixteen scenes are played side by side, so that each robot compiles once.
"""

import math

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import planar_scenes
from support.planar_scenes import (
    BLUE,
    CIRCLE,
    LANES,
    LEFT,
    OPEN,
    RIGHT,
    SQUARE,
    STAR,
    STEPS,
    YELLOW,
    begin,
    play,
    scene,
)

from gril_jax import envs

ROBOTS = ("gripper", "short", "medium", "long")
INERTIA = {"short": 0.00833, "medium": 0.03083, "long": 0.21417}
DT = 0.0125


def _actions(robot):
    """No drive, no turn, open fingers: (26, 16, A)."""
    actions = np.zeros((STEPS, LANES, 3 if robot == "gripper" else 2))
    actions[..., 2:] = -1.0
    return actions


# ---------------------------------------------------------------- free motion

TURNS = (0.005, 0.01, 0.02, 0.04, 0.0625, 0.5)


def _drive(robot, iterations):
    actions, pose = _actions(robot), np.stack([scene(robot, (0, -0.5, 0))] * LANES)
    actions[:6, 0, 0] = 1.0
    actions[:10, 1, 1] = 1.0
    pose[1] = scene(robot, (0, 0, 0))
    for lane, turn in enumerate(TURNS, start=2):
        actions[:, lane, 1] = turn
        pose[lane] = pose[1]
    actions[:, 8, :2] = 1.0
    pose[8] = scene(robot, (0.3, 0, 0))
    actions[:6, 9, 0], pose[9] = -1.0, scene(robot, (0, 0.3, 0))
    actions[:6, 10, 0] = 0.4
    actions[:10, 11, 2:] = 1.0
    actions[:, 12, 2:] = 0.2
    state = begin(pose, robot=robot, iterations=iterations)
    return play(state, actions, robot=robot, iterations=iterations)[0]


# Sticks differ from each other in their length alone.
DRIVEN = [pytest.param(r, marks=pytest.mark.slow) if r in ("medium", "long") else r for r in ROBOTS]


@pytest.fixture(scope="module", params=DRIVEN)
def driving(request):
    """A robot's name and its base's poses (16, 27, 3), lane by lane: see the tests' names."""
    return request.param, _drive(request.param, 10)[:, :, 0]


@pytest.fixture(scope="module")
def gripper():
    return _drive("gripper", 10)


SPEED = {  # displacement a step: from rest, and after the drive stops
    "gripper": ([0.0281, 0.0869], [0.0719, 0.0131]),
    "stick": ([0.0352, 0.0958], [0.0648, 0.0042]),
}
TURN = {  # rad a step: from rest; after a full turn; by how much they are off our law, see below
    "gripper": ([0.195], [0.119], 0.0045),
    "short": ([0.269], [0.045], 0.002),
    "medium": ([0.199], [0.115], 0.004),
    "long": ([0.033, 0.105, 0.176, 0.247, 0.306], [0.28], 0.005),
}


def test_robot_starts_and_stops_like_the_references(driving):
    robot, pose = driving
    start, stop = SPEED["gripper" if robot == "gripper" else "stick"]
    moved = np.diff(pose[0, :, 1])
    np.testing.assert_allclose(moved[:2], start, atol=1e-4)
    np.testing.assert_allclose(moved[2:6], 0.1, atol=1e-5)
    np.testing.assert_allclose(moved[6:8], stop, atol=1e-4)
    np.testing.assert_allclose(moved[8:], 0.0, atol=1e-5)


def test_robot_drives_straight_and_reverse_mirrors_forward(driving):
    _, pose = driving
    moved = np.diff(pose[:, :, 1])
    np.testing.assert_allclose(moved[9], -moved[0], atol=1e-5)
    np.testing.assert_allclose(moved[10, 1:6], 0.05, atol=1e-5)
    np.testing.assert_allclose(pose[[0, 9, 10]][..., [0, 2]], 0.0, atol=1e-5)


def test_robot_starts_and_stops_to_turn_like_the_references(driving):
    robot, pose = driving
    start, stop, off = TURN[robot]
    turned = np.diff(pose[1, :, 2])
    np.testing.assert_allclose(turned[: len(start)], start, atol=off)
    np.testing.assert_allclose(turned[len(start) + 1 : 10], 0.3125, atol=1e-4)
    np.testing.assert_allclose(turned[10 : 10 + len(stop)], stop, atol=off)
    np.testing.assert_allclose(turned[16:], 0.0, atol=1e-4)
    np.testing.assert_allclose(pose[1, :, :2], 0.0, atol=1e-5)  # on the spot


def test_turning_is_linear_up_to_one_sixteenth_and_then_saturates(driving):
    _, pose = driving
    rates = [0.025, 0.05, 0.10, 0.20, 0.3125, 0.3125]
    turned = np.diff(pose[2:8, :, 2])
    np.testing.assert_allclose(turned[:, 8:], np.transpose([rates] * 18), atol=1e-4)


def test_driving_while_turning_makes_the_references_circle(gripper):
    x, y = gripper[8, 6:, 0, :2].T
    (a, b, c), *_ = np.linalg.lstsq(np.stack([2 * x, 2 * y, 1 + 0 * x], 1), x**2 + y**2, rcond=None)
    assert math.sqrt(c + a * a + b * b) == pytest.approx(0.318, abs=0.0025)  # 0.8 / 2.5 = 0.32


def test_fingers_close_and_open_like_the_references(gripper):
    left, right = (gripper[11, :, e, 2] - gripper[11, :, 0, 2] for e in (1, 2))
    closed, opened = [0.280, 0.155, 0.043, 0.009, 0.002], [0.113, 0.238, 0.350, 0.384, 0.391]
    np.testing.assert_allclose(left[1:6], closed, atol=6e-4)
    np.testing.assert_allclose(left[11:16], opened, atol=6e-4)
    np.testing.assert_allclose(right, -left, atol=1e-5)


def test_grip_is_graded_between_open_and_closed(gripper):
    assert gripper[12, -1, 1, 2] - gripper[12, -1, 0, 2] == pytest.approx(OPEN - 0.2, abs=1e-3)


def test_fingers_stay_on_their_pivots(gripper):
    for lane in (0, 1, 8, 11):
        for pose in gripper[lane]:
            pivots = planar_scenes.parts("gripper", pose[0])[1:, :2]
            assert np.linalg.norm(pose[1:3, :2] - pivots, axis=1).max() < 5e-3


@pytest.mark.parametrize(
    "robot",
    ["short", *(pytest.param(r, marks=pytest.mark.slow) for r in ("medium", "long"))],
)
def test_a_stick_turns_as_its_servo_and_inertia_say(robot):
    """The servo aims at the commanded offset less the turn since; a torque of 1 limits it."""
    spin = angle = 0.0
    angles = [0.0]
    for t in range(10):
        for _ in range(10):
            angle += DT * spin
            offset = 1.0 if t < 10 else 0.0
            aim = np.clip(offset / DT - spin, -2.5, 2.5)
            spin += np.clip(aim - spin, -DT / INERTIA[robot], DT / INERTIA[robot])
        angles.append(angle)
    np.testing.assert_allclose(_drive(robot, 10)[1, :11, 0, 2], angles, atol=1e-4)


@pytest.mark.slow
def test_four_sweeps_move_a_free_robot_as_ten_do(gripper):
    np.testing.assert_allclose(_drive("gripper", 6), gripper, atol=2e-3)


# ---------------------------------------------------------------- contacts


def _row(count, robot):
    """A robot at the left, heading right, and this many blocks in a row before it."""
    order = (CIRCLE, SQUARE, BLUE, YELLOW)[:count]
    blocks = {b: (-0.55 + 0.25 * i, -0.3, 0) for i, b in enumerate(order)}
    return scene(robot, (-0.85, -0.3, RIGHT), blocks)


def _push(robot, iterations):
    actions = _actions(robot)
    actions[:, :, 0] = 1.0
    pose = np.stack([scene(robot, (0, 0, 0))] * LANES)
    for lane in range(4):
        pose[lane] = _row(lane + 1, robot)
    pose[4] = scene(robot, (-0.9, -0.3, RIGHT), {CIRCLE: (-0.4, -0.3, 0)})
    actions[8:, 4, 0] = -1.0
    pose[5] = scene(robot, (-0.9, -0.3, RIGHT), {SQUARE: (-0.4, -0.3, 0)})
    actions[10:, 5, 0] = 0.0
    pose[6] = scene(robot, (-0.9, -0.3, RIGHT), {SQUARE: (-0.45, -0.3, 0)})
    actions[:, 6, 0] = 0.3
    actions[3:, 6, 2:] = 1.0
    actions[12:, 6, 0] = -0.5
    for block in range(5):  # into the wall, which is 0.5 away
        pose[7 + block] = scene(robot, (0.0, -0.4, RIGHT), {block: (0.6, -0.4, 0.3 * block)})
    pose[12] = scene(robot, (0.4, 0.5, LEFT + 0.5))  # alone into a wall, askew
    return play(begin(pose, robot=robot, iterations=iterations), actions, robot=robot,
                iterations=iterations)[0]  # fmt: skip


@pytest.fixture(scope="module")
def pushing():
    """Ten sweeps, as the original; lane by lane: see the tests' names."""
    return _push("gripper", 10)


@pytest.fixture(scope="module")
def pushing_by_default():
    return _push("gripper", 6)


def _base(pose):
    return pose[..., 0, 0]


def _block(pose, block):
    return pose[..., pose.shape[-2] - 5 + block, :]


def test_robot_pushes_three_blocks_and_stalls_on_four(pushing):
    steps = np.diff(_base(pushing[:4]), axis=1)
    for count in (1, 2, 3):
        assert steps[count - 1].max() == pytest.approx(0.1, abs=1e-3), count
    # 0.12 in all is the way to the row and into the gaps of 0.01 to 0.03 between its blocks
    assert steps[3].sum() < 0.2
    np.testing.assert_allclose(steps[3, 8:], 0.0, atol=2e-3)


@pytest.mark.parametrize("robot", ["short", pytest.param("medium", marks=pytest.mark.slow)])
def test_sticks_push_three_blocks_and_stall_on_four(robot):
    steps = np.diff(_base(_push(robot, 10)[:4]), axis=1)
    for count in (1, 2, 3):
        assert steps[count - 1].max() == pytest.approx(0.1, abs=1e-3), count
    np.testing.assert_allclose(steps[3, 16:], 0.0, atol=2e-3)


@pytest.mark.slow
def test_four_blocks_creep_a_little_with_the_default_sweeps(pushing_by_default):
    """Fewer sweeps bring less of the robot's push to the table; what is left is half a unit."""
    steps = np.diff(_base(pushing_by_default[:4]), axis=1)
    for count in (1, 2, 3):
        assert steps[count - 1].max() == pytest.approx(0.1, abs=1e-3), count
    assert steps[3].max() < 0.065
    assert steps[3].sum() < 0.5
    np.testing.assert_allclose(steps[3, 18:], 0.0, atol=5e-3)


@pytest.fixture(scope="module", params=[pytest.param(6, marks=pytest.mark.slow), 10])
def either(request):
    return request.getfixturevalue("pushing" if request.param == 10 else "pushing_by_default")


def test_pushed_blocks_go_as_fast_as_the_robot(either):
    circle = np.diff(_block(either[0], CIRCLE)[:, 0])
    robot = np.diff(_base(either[0]))
    np.testing.assert_allclose(circle[6:12], robot[6:12], atol=2e-3)
    np.testing.assert_allclose(circle[6:12], 0.1, atol=1e-3)


def test_a_block_stays_where_the_robot_leaves_it(either):
    circle = _block(either[4], CIRCLE)[:, :2]
    assert circle[8, 0] - circle[0, 0] > 0.3  # pushed before
    assert np.linalg.norm(circle[11:] - circle[11], axis=1).max() < 1e-3


def test_a_block_stops_with_the_robot(either):
    square, robot = _block(either[5], SQUARE)[:, 0], _base(either[5])
    assert square[10] - square[0] > 0.5
    assert square[-1] - square[10] == pytest.approx(robot[-1] - robot[10], abs=3e-3)
    assert np.ptp(square[13:]) < 1e-3


@pytest.mark.parametrize("iterations", [pytest.param(6, marks=pytest.mark.slow), 10])
def test_a_sliding_block_stops_within_one_substep(iterations):
    pose = np.stack([scene("gripper", (0, 0, 0), {STAR: (0.6, -0.4, 0)})] * LANES)
    velocity = np.zeros_like(pose)
    velocity[0, 3, :2], velocity[1, 4, 0], velocity[2, 3, 2] = 0.8, -0.8, 10.0
    state = begin(pose, velocity, iterations=iterations)
    poses, states = play(state, _actions("gripper"), iterations=iterations)
    assert np.abs(poses[0, 1] - poses[0, 0])[:, :2].max() <= 0.8 * DT + 1e-5
    assert poses[2, 1, 3, 2] <= 10 * DT + 0.05
    np.testing.assert_allclose(states.data.velocity[-1][:3, 3:], 0.0, atol=1e-4)
    np.testing.assert_allclose(poses[:3, 2:], poses[:3, 1:-1], atol=1e-4)


def test_gripped_block_is_dragged_backwards(either):
    square, robot = _block(either[6], SQUARE)[:, 0], _base(either[6])
    assert robot[12] - robot[20] > 0.3
    assert square[12] - square[20] > 0.9 * (robot[12] - robot[20])


def test_blocks_pushed_into_a_wall_stay_in_the_arena(either):
    for block in range(5):
        assert _block(either[7 + block], block)[-1, 0] > 0.85  # it got there
    assert planar_scenes.overhang(planar_scenes.task(), either[7:13]).max() < 0.03


# ---------------------------------------------------------------- robustness


def test_nothing_breaks_under_random_and_extreme_actions():
    rng = np.random.default_rng(0)
    extreme = [-1e30, -1e3, -1.0, 0.0, 1.0, 1e3, 1e30]
    blocks = {b: (-0.8 + 0.4 * b, -0.6, 0) for b in range(5)}
    first = state = begin(np.stack([scene("gripper", (0, 0, 0), blocks)] * LANES))
    env, worst = planar_scenes.task(), 0.0
    for part in range(10):
        shape = (STEPS, LANES, 3)
        actions = rng.uniform(-1, 1, shape) if part < 6 else rng.choice(extreme, shape)
        poses, states = play(state, actions)
        chex.assert_tree_all_finite(states)
        state = jax.tree.map(lambda leaf: leaf[-1], states)
        worst = max(worst, planar_scenes.overhang(env, poses).max())
    chex.assert_trees_all_equal_shapes_and_dtypes(state, first)
    assert worst < 0.05
    moved = np.abs(np.asarray(state.data.pose - first.data.pose))[:, 3:].max(axis=(1, 2))
    assert (moved > 0.1).mean() > 0.5  # the actions did reach blocks


def test_lanes_do_not_influence_each_other():
    actions = np.random.default_rng(1).uniform(-1, 1, (STEPS, LANES, 3))
    state = begin(np.stack([scene("gripper", (0, 0, 0), {SQUARE: (0, 0.3, 0)})] * LANES))
    others = actions.copy()
    others[:, 1::2] = -others[:, 1::2]
    one, two = play(state, actions)[0], play(state, others)[0]
    np.testing.assert_array_equal(one[0::2], two[0::2])  # the same place in a vector: to the bit
    assert np.abs(one[1::2] - two[1::2]).max() > 0.1


@pytest.mark.slow
def test_a_scene_settled_under_its_action_goes_on_as_before():
    """A push that is under way: with the solver's memory made anew, the next poses are the same."""
    env = envs.make("match_regions", targets=("yellow circle",), distractors=())
    pose = np.array([*planar_scenes.parts("gripper", (-0.85, -0.3, RIGHT)), (-0.55, -0.3, 0.0)])
    push = jnp.array([1.0, 0.0, -1.0])

    @jax.jit
    def roll(state):
        def move(state, _):
            state = env.step(state, push)
            return state, state

        return jax.lax.scan(move, state, length=12)[1]

    states = roll(jax.jit(env.reset_to)(jnp.float32(pose), jnp.zeros((4, 3))))
    poses, now = np.asarray(states.data.pose), jax.tree.map(lambda leaf: leaf[6], states)
    settle = jax.jit(lambda *scene: env.reset_to(*scene, action=push))
    again = settle(now.data.pose, now.data.velocity)
    chex.assert_trees_all_equal(again.data.pose, now.data.pose)
    assert poses[11, 3, 0] - poses[6, 3, 0] > 0.4  # it is pushed
    np.testing.assert_allclose(roll(again).data.pose[:5], poses[7:12], atol=2e-3)


def test_memory_is_as_long_as_it_says_and_zero_at_rest():
    for robot in ROBOTS:
        engine = envs.make("match_regions", robot=robot, engine="impulse")._engine
        assert engine.rest().shape == (engine._pack(engine._none()).size,)
        assert not engine.rest().any()
