"""The MJX engine against the impulse engine where both must agree, and against plain facts.

One compiled control step of 16 lanes serves the whole file: compiling takes most of its time.
"""

import functools
import math

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.joints import Command, Strengths
from gril_jax.envs.planar.mjx_engine import MjxPhysics
from gril_jax.envs.planar.physics import Physics
from gril_jax.envs.planar.robots import robot

from gril_jax import envs

LANES = 16
OPEN = math.pi / 8
SHAPES = ("star", "square", "pentagon", "circle", "pentagon")
STRENGTHS = Strengths(*(jnp.float32(s) for s in (5.0, 1.0, 4.0, 1.5, 0.1)))
AWAY = [(0.9, 0.9, 0), (-0.9, 0.9, 0), (-0.9, -0.9, 0), (0.9, -0.9, 0), (0.93, 0.5, 0)]
SLIPPERY = (5.0, 1.0, 4.0, 0.15, 0.01)  # strengths on a table of a tenth of the friction


@functools.cache
def _engine():
    return MjxPhysics(SHAPES, arena=1.1)


def _shapes(names=SHAPES):
    index = [block_shapes.SHAPES.index(s) for s in names]
    return block_shapes.blocks(jnp.array(index, jnp.int32))


def _command(engine, action):
    """Arguments of an engine for MatchRegions."""
    turn = 2 * engine.dt * 40.0 * action[1]
    return Command(jnp.clip(action[0], -0.8, 0.8), turn, jnp.clip(OPEN - action[2], 0.0, OPEN))


@functools.cache
def _lanes(which):
    """A control step of 16 lanes of either engine; the impulse engine has one block only."""
    engine, shapes = _engine(), _shapes()
    if which == "impulse":
        engine = Physics(robot("gripper"), 1, arena=1.1, iterations=4)
        shapes = _shapes(SHAPES[:1])

    def step(pose, velocity, memory, strengths, action):
        command = _command(engine, action)
        return engine.step(pose, velocity, memory, shapes, Strengths(*strengths), command)

    return jax.jit(jax.vmap(step)), np.tile(np.asarray(engine.rest()), (LANES, 1))


def _scene(base=(0.0, 0.0, 0.0), blocks=None, opening=OPEN):
    """Poses (8, 3): the gripper at `base`, blocks out of its way but for those given."""
    x, y, yaw = base
    c, s = math.cos(yaw), math.sin(yaw)
    pivots = np.array([[-0.09, 0.02], [0.09, 0.02]]) @ np.array([[c, s], [-s, c]]) + [x, y]
    fingers = [(*p, yaw + k * opening) for p, k in zip(pivots, (1, -1), strict=True)]
    rest = [(blocks or {}).get(b, away) for b, away in enumerate(AWAY)]
    return np.array([base, *fingers, *rest], np.float32)


def _play(pose, actions, velocity=None, strengths=None, which="mjx"):
    """Poses and velocities (T + 1, 16, 8, 3) under actions (T, 16, 3)."""
    step, memory = _lanes(which)
    velocity = np.zeros_like(pose) if velocity is None else velocity
    strengths = np.tile(np.array(STRENGTHS), (LANES, 1)) if strengths is None else strengths
    poses, velocities = [pose], [velocity]
    for action in actions:
        out = step(poses[-1], velocities[-1], memory, strengths, np.asarray(action, np.float32))
        for kept, new in zip((poses, velocities), out, strict=False):
            kept.append(np.asarray(new))
        memory = out[2]
    return np.array(poses), np.array(velocities)


def _held(action, steps):
    return np.tile(np.asarray(action, np.float32), (steps, LANES, 1))


def _same(scene):
    return np.tile(scene, (LANES, 1, 1))


@pytest.fixture(scope="module")
def free():
    """Both engines' next states from each state of random drives far from everything."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (4, LANES, 3)).astype(np.float32)
    actions[:, ::2, 1] *= 0.06  # every other lane turns slowly
    starts = np.stack([_scene((0, 0, yaw)) for yaw in rng.uniform(-math.pi, math.pi, LANES)])
    poses, velocities = _play(starts[:, :4], actions, which="impulse")
    others = np.broadcast_to(starts[:, 4:], (5, LANES, 4, 3))
    poses = np.concatenate([poses, others], axis=2)
    velocities = np.concatenate([velocities, np.zeros_like(others)], axis=2)
    moves = zip(poses[:-1], velocities[:-1], actions, strict=True)
    fresh = [_play(pose, action[None], velocity)[0][1] for pose, velocity, action in moves]
    return poses[1:], np.array(fresh)


@pytest.mark.slow
def test_free_motion_is_the_impulse_engines_within_a_control_step(free):
    """The fingers' as well, which stay on their pivots; blocks stay where they are."""
    impulse, ours = free
    gap = np.linalg.norm(impulse[:, :, :3, :2] - ours[:, :, :3, :2], axis=-1)
    assert gap.max() < 0.003
    np.testing.assert_allclose(ours[..., 0, 2], impulse[..., 0, 2], atol=0.015)
    opening = [f[..., 1:3, 2] - f[..., :1, 2] for f in free]
    np.testing.assert_allclose(*opening, atol=0.025)
    assert np.abs(ours[:, :, 3:] - np.array(AWAY)).max() < 1e-5
    x, y, yaw = np.moveaxis(ours[..., 0, :], -1, 0)
    for finger, side in ((1, -1), (2, 1)):
        c, s = np.cos(yaw), np.sin(yaw)
        pivot = np.stack([x + side * 0.09 * c - 0.02 * s, y + side * 0.09 * s + 0.02 * c], -1)
        np.testing.assert_allclose(ours[..., finger, :2], pivot, atol=1e-6)


def test_velocities_are_the_rates_of_the_poses():
    """At a steady drive and turn, poses change as the velocities say, the fingers' included."""
    poses, velocities = _play(_same(_scene()), _held([0.5, 0.03, 0.0], 5))
    rate = (poses[5] - poses[4]) / 0.125
    middle = (velocities[5] + velocities[4]) / 2
    np.testing.assert_allclose(rate, middle, atol=0.02)


@pytest.fixture(scope="module")
def pushing():
    """Lane b pushes block b ahead; lane 5 a block into a wall, lane 6 itself, lane 7 grips."""
    lanes = [_scene(blocks={b: (0.0, 0.37, 0.4)}) for b in range(5)]
    lanes.append(_scene((0.0, 0.5, 0.0), {1: (0.0, 0.85, 0.0)}))
    lanes.append(_scene((0.0, 0.5, 0.0)))
    lanes.append(_scene(blocks={3: (0.0, 0.325, 0.0)}))
    lanes += [lanes[0]] * (LANES - len(lanes))
    actions = _held([0.8, 0.0, 0.0], 10)
    actions[:, 7] = [0.0, 0.0, 1.0]
    actions[4:, 7, 0] = -0.8
    return _play(np.stack(lanes), actions)[0]


def test_a_pushed_block_goes_with_the_robot(pushing):
    for b in range(5):
        way = pushing[-1, b, 3 + b] - pushing[0, b, 3 + b]
        robot_way = pushing[-1, b, 0, 1] - pushing[0, b, 0, 1]
        assert 0.4 < way[1] < robot_way + 0.02, SHAPES[b]


def test_blocks_that_nothing_touches_stay(pushing):
    for b in range(5):
        others = [3 + k for k in range(5) if k != b]
        np.testing.assert_allclose(pushing[-1, b, others], pushing[0, b, others], atol=1e-4)


def test_walls_hold_the_robot_and_the_block_before_it(pushing):
    assert pushing[-1, 5, 4, 1] + 0.1063 < 1.1 + 0.01
    fingertip = 0.02 + 0.36  # a little more than the open fingers reach ahead
    assert 1.1 - fingertip < pushing[-1, 6, 0, 1] < 1.1 - 0.3


def test_a_gripped_block_is_dragged_backwards(pushing):
    way = pushing[-1, 7, 6] - pushing[4, 7, 6]
    robot_way = pushing[-1, 7, 0] - pushing[4, 7, 0]
    assert robot_way[1] < -0.4
    assert way[1] < 0.8 * robot_way[1]


def test_a_block_slides_as_far_along_a_diagonal_as_along_an_axis():
    """The table's friction is a disc: with MuJoCo's square, diagonals would stop sooner."""
    directions = np.linspace(0, math.pi / 2, LANES)
    pose, velocity = _same(_scene((0.0, -0.8, 0.0), {3: (0, 0, 0)})), np.zeros((LANES, 8, 3))
    velocity[:, 6, :2] = 3.0 * np.stack([np.cos(directions), np.sin(directions)], -1)
    slippery = np.tile(np.array(SLIPPERY, np.float32), (LANES, 1))
    poses, velocities = _play(pose, _held([0, 0, 0], 4), velocity.astype(np.float32), slippery)
    way = np.linalg.norm(poses[-1, :, 6, :2], axis=-1)
    assert np.abs(velocities[-1, :, 6]).max() < 1e-3
    np.testing.assert_allclose(way, 3.0**2 / (2 * 0.15 / 0.01), rtol=0.15)
    assert np.ptp(way) < 0.02 * way.mean()


def test_stronger_drives_start_faster():
    strengths = np.tile(np.array(STRENGTHS, np.float32), (LANES, 1))
    strengths[:, 0] = np.linspace(2.0, 5.0, LANES)
    poses, _ = _play(_same(_scene()), _held([0.8, 0, 0], 1), strengths=strengths)
    assert (np.diff(poses[1, :, 0, 1]) > 0).all()


def test_nothing_breaks_under_extreme_actions():
    rng = np.random.default_rng(1)
    xy = rng.uniform(-0.9, 0.9, (LANES, 6, 2))  # bodies may overlap
    starts = np.stack([_scene((*p[0], 0.0), {b: (*p[b + 1], 1.0) for b in range(5)}) for p in xy])
    actions = rng.choice([-1.0, 1.0], (30, LANES, 3))
    poses, velocities = _play(starts, actions)
    assert np.isfinite(poses).all()
    assert np.isfinite(velocities).all()
    assert np.abs(poses[-1, :, [0, 3, 4, 5, 6, 7], :2]).max() < 1.1


def test_lanes_do_not_influence_each_other():
    """vmap equals itself with other neighbours."""
    lanes = np.stack([_scene(blocks={k % 5: (0.0, 0.3, 0.1 * k)}) for k in range(LANES)])
    actions = np.tile(np.linspace(-1, 1, LANES)[:, None], (3, 1, 3)).reshape(3, LANES, 3)
    poses, _ = _play(lanes, actions)
    swapped, _ = _play(lanes[::-1].copy(), actions[:, ::-1])
    np.testing.assert_allclose(swapped[:, ::-1], poses, atol=1e-5)


def test_inertia_of_the_drive_is_mujocos():
    engine, rng = _engine(), np.random.default_rng(0)
    model = engine.mj_model
    data, column = mujoco.MjData(model), np.zeros(model.nv)
    for qpos in rng.uniform(-1, 1, (10, model.nq)):
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        ours = np.asarray(engine._inertia(jnp.float32(qpos[2])))
        for joint, expected in enumerate(ours.T):
            mujoco.mj_mulM(model, data, column, np.eye(model.nv)[joint])
            np.testing.assert_allclose(column[:5], expected, atol=2e-6)
            np.testing.assert_array_equal(column[5:], 0.0)  # blocks are no part of the robot


def test_memory_is_as_long_as_it_says_and_settling_fills_it():
    engine = MjxPhysics(("circle",), arena=1.1)  # compiles faster
    pose, circle = jnp.asarray(_scene()[:4]), _shapes(("circle",))
    assert engine.rest().shape == (8,)
    assert not engine.rest().any()
    command = _command(engine, jnp.array([0.8, 0.0, 0.0]))
    memory = jax.jit(engine.settle)(pose, jnp.zeros_like(pose), circle, STRENGTHS, command)
    np.testing.assert_allclose(memory[:2], [0.0, 4.0], atol=1e-3)  # force 5 on a mass of 1.25


def test_clearance_is_that_of_the_outlines():
    engine = MjxPhysics(("circle",), arena=1.1)
    pose = jnp.asarray(_scene(blocks={0: (0.0, -0.5, 0.0)})[:4])
    gap = jax.jit(engine.clearance)(pose, _shapes(("circle",)))
    assert gap == pytest.approx(0.5 - 0.2 - 0.12, abs=1e-5)


def test_the_task_offers_both_engines_and_keeps_its_state():
    task = envs.make("match_regions", engine="mjx")
    state = jax.eval_shape(task.reset, jax.random.key(0))
    after = jax.eval_shape(task.step, state, jnp.zeros(3))
    assert jax.tree.map(lambda f: (f.shape, f.dtype), state) == jax.tree.map(
        lambda f: (f.shape, f.dtype), after
    )
    assert task._engine.substeps == 5
    assert envs.make("match_regions", engine="mjx", substeps=4)._engine.substeps == 4
    assert envs.make("match_regions", engine="impulse")._engine.substeps == 10


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"robot": "long"}, "engine 'mjx' serves the robot 'gripper' only, not 'long'"),
        ({"physics": "magical"}, "engine 'mjx' serves the physics 'xmagical' only, not 'magical'"),
        (
            {"variant": "shape"},
            "engine 'mjx' has fixed shapes and cannot serve the variant 'shape'",
        ),
        ({"variant": "all"}, "engine 'mjx' has fixed shapes and cannot serve the variant 'all'"),
    ],
)
def test_what_the_engine_does_not_serve_is_refused_in_one_sentence(options, words):
    with pytest.raises(ValueError, match=f"^{words}$"):
        envs.make("match_regions", engine="mjx", **options)


@pytest.mark.parametrize(
    ("task", "options", "words"),
    [
        ("make_line", {"variant": "countplus"}, "fixed shapes and cannot serve the variant 'count"),
        ("match_regions_magical", {"padded": True}, "fixed blocks, but the task has room for more"),
    ],
)
def test_numbers_of_blocks_that_change_are_refused(task, options, words):
    with pytest.raises(ValueError, match=words):
        envs.make(task, engine="mjx", physics="xmagical", **options)


def test_an_unknown_engine_is_one_sentence_with_the_known_ones():
    with pytest.raises(
        ValueError, match="engine is 'mujoco', but must be one of auto, impulse, kernel, mjx"
    ):
        envs.make("match_regions", engine="mujoco")
