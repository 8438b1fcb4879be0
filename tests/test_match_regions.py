"""MatchRegions against its specification: starts, rewards, objects, observation, options.

Reference numbers are those of the original simulator. Motion has its own file, and so have layouts,
rewards and observations as functions. One compiled step of 16 lanes serves most of this file.
"""

import functools
import math

import chex
import jax
import jax.numpy as jnp
import numpy as np
import planar_scenes
import pytest
import scenes
from gril_jax.envs import match_regions, robots
from gril_jax.envs import match_regions_layout as layouts

from gril_jax import envs

LANES = 16
OPEN = math.pi / 8
STAR, SQUARE, BLUE, CIRCLE, YELLOW = range(5)
NAMES = ("green star", "green square", "blue pentagon", "yellow circle", "yellow pentagon")
GOAL = np.array([0.40, 0.35])


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
    """States of 16 lanes from poses, perhaps velocities; distances as at reset."""
    function = jax.jit(jax.vmap(env._observe))

    def states(pose, velocity=None):
        velocity = np.zeros_like(pose) if velocity is None else velocity
        data = demo.data._replace(
            pose=jnp.asarray(pose, jnp.float32), velocity=jnp.asarray(velocity, jnp.float32)
        )
        return function(data)

    return states


@pytest.fixture(scope="module")
def at_demo(demo, observe):
    """A function of 16 dicts, each block -> (x, y[, angle]): the Demo layout but for these."""

    def states(changes):
        pose = np.array(demo.data.pose)
        for lane, moves in enumerate(changes):
            for block, place in moves.items():
                pose[lane, 3 + block, : len(place)] = place
        return observe(pose)

    return states


# ---------------------------------------------------------------- start and score


def test_demo_begins_at_the_reference_poses(demo):
    pose = np.asarray(demo.data.pose[0])
    robot = planar_scenes.parts("gripper", (-0.5, 0.1, -1.2 * math.pi))
    np.testing.assert_allclose(pose[:3], robot, rtol=1e-6)
    np.testing.assert_allclose(pose[3:], [scenes.BLOCKS[n] for n in NAMES], rtol=1e-6)
    np.testing.assert_allclose(demo.data.goal[0], [*GOAL, 0.6, 0.7], rtol=1e-6)
    np.testing.assert_array_equal(demo.data.velocity, 0.0)
    np.testing.assert_array_equal(demo.data.memory, 0.0)
    assert (np.asarray(demo.data.pose) == pose).all()  # the same for every key
    assert not demo.data.unplaced.any()


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
    pose = np.array(demo.data.pose)
    pose[:, 0, :2] = np.random.default_rng(0).uniform(-0.7, 0.7, (LANES, 2))
    np.testing.assert_allclose(observe(pose).reward, demo.reward, rtol=1e-6)


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
    assert env.classes == match_regions.CLASSES


def test_boxes_of_blocks_are_those_of_their_turned_outlines(observe):
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


def test_boxes_of_region_and_robot_are_the_rectangle_and_the_disc(observe):
    pose, _ = _random_poses(2)
    objects = observe(pose).objects
    np.testing.assert_allclose(objects.center[:, 0], [GOAL] * LANES, rtol=1e-6)
    np.testing.assert_allclose(objects.size[:, 0], [[0.6, 0.7]] * LANES, rtol=1e-6)
    np.testing.assert_allclose(objects.center[:, 1], pose[:, 0, :2], atol=1e-6)
    np.testing.assert_allclose(objects.size[:, 1], 0.4, rtol=1e-6)


def _expected_observation(pose, velocity):
    """The "rich" observation, number by number, in float64."""
    (x, y, yaw), left, right = pose[0], pose[1, 2], pose[2, 2]
    ahead, side = (
        np.array([-math.sin(yaw), math.cos(yaw)]),
        np.array([math.cos(yaw), math.sin(yaw)]),
    )

    def in_robot_frame(point):
        offset = np.asarray(point) - [x, y]
        return [offset @ side, offset @ ahead]

    row = [x, y, math.cos(yaw), math.sin(yaw)]
    row += [
        velocity[0, :2] @ ahead,
        velocity[0, :2] @ side,
        velocity[0, 2] / 2.5,
        (left - right) / (2 * OPEN),
    ]
    row += [*in_robot_frame(GOAL), *GOAL, 0.6, 0.7]
    for (bx, by, angle), (vx, vy, spin) in zip(pose[3:], velocity[3:], strict=True):
        within = abs(bx - GOAL[0]) <= 0.3 and abs(by - GOAL[1]) <= 0.35
        row += [*in_robot_frame((bx, by)), bx, by, bx - GOAL[0], by - GOAL[1], vx, vy]
        row += [math.cos(angle), math.sin(angle), spin / 10, float(within)]
    return row


def test_observation_is_what_the_docstring_says_index_by_index(env, observe):
    pose, velocity = _random_poses(3)
    obs = np.asarray(observe(pose, velocity).obs)
    expected = np.array([_expected_observation(*row) for row in zip(pose, velocity, strict=True)])
    assert obs.shape == expected.shape == (LANES, env.observation_size)
    np.testing.assert_allclose(obs, expected, atol=2e-6)
    assert 0 < expected[:, 14 + 11 :: 12].mean() < 1  # both inside and outside occur


# ---------------------------------------------------------------- actions


def test_smooth_turning_is_linear_over_the_whole_range(env):
    smooth = envs.make("match_regions", turn="smooth")
    for turn in (0.02, 0.3, 1.0):
        gentle = smooth._command(jnp.array([0.0, turn, 0.0]))
        original = env._command(jnp.array([0.0, turn / 16, 0.0]))
        chex.assert_trees_all_close(gentle, original, rtol=1e-6)


@pytest.mark.parametrize(
    ("action", "speed", "turn", "opening"),
    [
        ([1.0, 0.0, 0.0], 0.8, 0, OPEN),
        ([0.3, 0.0, 0.0], 0.0, 0, OPEN),
        ([-0.6, 0.0, -1.0], -0.6, 0, OPEN),
        ([0.0, 0.6, 0.1], 0.0, 1.5, 0.0),
        ([0.0, -0.9, 1.0], 0.0, -1.5, 0.0),
        ([0.0, 0.4, 0.0], 0.0, 0, OPEN),
    ],
)
def test_magical_rounds_actions_to_its_eighteen(action, speed, turn, opening):
    magical = envs.make("match_regions", physics="magical")
    command = magical._command(jnp.array(action))
    np.testing.assert_allclose(list(map(float, command)), [speed, turn, opening], rtol=1e-6)


def test_actions_beyond_the_box_act_like_its_border(demo, step):
    action = np.tile([7.0, -7.0, 7.0], (LANES, 1))
    a = step(demo, jnp.asarray(action, jnp.float32))
    b = step(demo, jnp.asarray(np.sign(action), jnp.float32))
    chex.assert_trees_all_equal(a, b)


def test_nearest_is_the_least_distance_since_reset(demo, step):
    """The robot of the Demo start drives away from the square and, later, back."""
    state, least = demo, np.asarray(demo.data.nearest)
    for t in range(10):
        action = jnp.tile(jnp.array([1.0 if t < 5 else -1.0, 0.0, 0.0]), (LANES, 1))
        state = step(state, action)
        pose = np.asarray(state.data.pose)
        least = np.minimum(least, np.linalg.norm(pose[:, 3:5, :2] - pose[:, :1, :2], axis=2))
        np.testing.assert_allclose(state.data.nearest, least, rtol=1e-5)


# ---------------------------------------------------------------- starts


@functools.cache
def _starts(**options):
    """The task, and 200 of its starts."""
    env = envs.make("match_regions", **options)
    keys = jax.random.split(jax.random.key(5), 200)
    return env, jax.jit(jax.vmap(env.reset))(keys)


@pytest.fixture(scope="module")
def jittered():
    return _starts(variant="jitter")


@pytest.fixture(scope="module")
def scattered():
    return _starts(variant="layout")


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


def test_jitter_moves_everything_a_little_and_within_its_bounds(demo, jittered):
    _, state = jittered
    which = [0, *range(3, 8)]
    poses, reference = np.asarray(state.data.pose)[:, which], np.asarray(demo.data.pose)[0, which]
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
    assert not state.data.unplaced.any()
    assert _clearances(env, state).min() > -1e-3  # the layout's radii are rounded
    assert _overhang(env, state) < 1e-3
    assert not np.asarray(state.obs)[:, 14 + 11 :: 12].any()
    goal = np.asarray(state.data.goal)
    assert (np.abs(goal[:, :2]) + goal[:, 2:] / 2 <= env.arena + 1e-6).all()
    assert goal[:, 2:].min() >= 0.5
    assert goal[:, 2:].max() <= 0.8
    assert np.ptp(goal[:, 2:]) > 0.28


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
    ours, theirs = state.data.pose[own], demo.data.pose[:1].repeat(own.sum(), 0)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
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
    assert not state.data.unplaced.any()
    assert _clearances(env, state)[np.asarray(state.data.varied) == 1].min() > -1e-3
    robots = np.asarray(state.data.pose)[:, 0, :2]
    assert np.ptp(robots, axis=0).min() > 1.0  # as far as the blocks leave room
    assert _overhang(env, state) < 1e-3


def test_reward_of_a_varied_start_is_that_of_the_same_scene_reached_from_the_demo_start(
    varied, demo, observe
):
    """It measures progress from the task's own start, so a target in place is worth as much."""
    _, _, state = varied
    first = np.asarray(state.data.pose)[:LANES]
    np.testing.assert_allclose(observe(first).reward, state.reward[:LANES], rtol=1e-5)


# ---------------------------------------------------------------- robots and variants

ROLLOUTS = [  # one compiled step each; shapes that are drawn make another program than fixed ones
    {"robot": "gripper", "variant": "all"},
    {"robot": "short", "variant": "all", "reward": "V5", "observation": "xmagical"},
    {"robot": "medium", "variant": "all", "reward": "S3"},
    {"robot": "long", "variant": "all", "reward": "sparse"},
    {"robot": "gripper", "physics": "magical", "observation": "xmagical", "reward": "V5"},
]


def _label(options):
    return "-".join(options.values())


@pytest.mark.parametrize("options", ROLLOUTS, ids=_label)
def test_episodes_stay_finite_and_in_the_arena_and_compile_once(options):
    env = envs.make("match_regions", **options)
    chex.clear_trace_counter()  # it counts by a function's name
    step = jax.jit(chex.assert_max_traces(lambda s, a: jax.vmap(env.step)(s, a), n=1))
    first = state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(2), LANES))
    extreme = [-1e30, -1e3, -1.0, 0.0, 1.0, 1e3, 1e30]
    rng, shape = np.random.default_rng(0), (LANES, env.action_size)
    for t in range(164):
        action = rng.uniform(-1, 1, shape) if t < 64 else rng.choice(extreme, shape)
        state = step(state, jnp.asarray(action, jnp.float32))
        if t % 8 == 3:
            chex.assert_tree_all_finite(state)
            chex.assert_trees_all_equal_shapes_and_dtypes(state, first)
            blocks = np.asarray(state.data.pose)[:, -5:, :2]
            assert np.abs(blocks).max() < env.arena - 0.05  # of centres
    assert jax.tree.structure(state) == jax.tree.structure(first)
    assert np.abs(np.asarray(state.data.pose - first.data.pose))[:, 0, :2].max() > 0.3


def _same_types(first, after):
    """Weak types too: one that changes would make a jitted step compile twice."""
    assert jax.tree.leaves(first) == jax.tree.leaves(after)
    assert jax.tree.structure(first) == jax.tree.structure(after)
    assert all(not leaf.weak_type for leaf in jax.tree.leaves(after))


@pytest.mark.parametrize(
    ("robot", "variant"),
    [("gripper", v) for v in layouts.VARIANTS] + [(r, "layout") for r in robots.ROBOTS[1:]],
)
def test_every_variant_keeps_its_structure_and_names_each_number(robot, variant):
    env = envs.make("match_regions", robot=robot, variant=variant)
    first = jax.eval_shape(env.reset, jax.random.key(0))
    assert first.obs.shape == (env.observation_size,) == (len(env.observation_names),)
    assert env.action_size == len(env.action_names) == (3 if robot == "gripper" else 2)
    _same_types(first, jax.eval_shape(env.step, first, jnp.zeros(env.action_size)))


def test_variants_draw_what_their_names_say():
    def drawn(variant):
        state = _starts(variant=variant)[1]
        chex.assert_tree_all_finite(state)
        data = state.data
        fields = (data.shape, data.colour, data.strengths, data.pose, data.goal)
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


def test_labels_are_those_of_drawn_colours_and_shapes():
    env, state = _starts(variant="all")
    label = np.asarray(state.objects.label)
    colour, shape = np.asarray(state.data.colour), np.asarray(state.data.shape)
    for lane in range(60):
        names = [env.classes[i] for i in label[lane, 2:]]
        expected = [
            f"{match_regions.COLOURS[c]} {match_regions.SHAPES[s]}"
            for c, s in zip(colour[lane], shape[lane], strict=True)
        ]
        assert names == expected


@pytest.mark.parametrize(("robot", "width"), [("short", 0.3), ("medium", 0.6), ("long", 1.6)])
def test_box_of_a_stick_is_that_of_its_turned_rectangle(robot, width):
    pose = np.stack([planar_scenes.scene(robot, (0.1, 0.0, 0.2 * k)) for k in range(LANES)])
    objects = planar_scenes.begin(pose, robot=robot).objects
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [width / 2, 0.05]
    boxes = [np.ptp(planar_scenes.turned(corners, 0.2 * k), axis=0) for k in range(LANES)]
    np.testing.assert_allclose(objects.size[:, 1], boxes, atol=1e-6)


# ---------------------------------------------------------------- the contract, any task


@pytest.fixture(params=envs.names())
def task(request):
    return envs.make(request.param)


def test_task_keeps_the_contract(task):
    assert isinstance(task, envs.Env)
    key, action = jax.random.key(0), jnp.zeros(task.action_size)
    first = jax.eval_shape(task.reset, key)
    after = jax.eval_shape(task.step, first, action)
    _same_types(first, after)
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
        ({"targets": ()}, ["targets", "at least one"]),
        ({"robot": "sticks"}, ["robot", "'sticks'", "gripper, short, medium, long"]),
        ({"physics": "mujoco"}, ["physics", "'mujoco'", "xmagical, magical"]),
        ({"observation": "state"}, ["observation", "'state'", "rich, xmagical"]),
        ({"reward": "sparce"}, ["reward", "'sparce'", "did you mean 'sparse'"]),
        ({"varied_starts": 1.5}, ["varied_starts", "1.5", "between 0 and 1"]),
        ({"substeps": 0}, ["substeps", "0", "at least 1"]),
        ({"iterations": 0}, ["iterations", "0", "at least 1"]),
        ({"episode_length": 0}, ["episode_length", "0", "at least 1"]),
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
