"""Shoes in the box: starts, stages, a scripted expert in C MuJoCo, and MJX beside it.

One compiled control step of 8 lanes serves the whole file: compiling takes most of its time.
"""

import functools

import chex
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.envs import tabletop
from gril_jax.envs.tabletop.moves import Hand
from gril_jax.envs.tabletop.start import Start
from gril_jax.envs.tabletop.tasks import shoe_box as scene
from support import tabletop_scenes as scenes

from gril_jax import envs

LANES = 8
BOX = np.array([[0.493, -0.15, 0, 1, 0, 0, 0]], np.float32)
SHOES = {
    "out": (0.48, 0.14, 0.025), "far": (0.48, 0.27, 0.025), "in": (0.46, -0.19, 0.025),
    "beside": (0.52, -0.11, 0.026), "on top": (0.46, -0.19, 0.075), "above": (0.46, -0.19, 0.14),
}  # fmt: skip
ASIDE = np.array(tabletop.HOME, np.float32)


@functools.cache
def _env():
    return envs.make("shoes_in_box")


@functools.cache
def _reset():
    return jax.jit(jax.vmap(_env().reset))


@functools.cache
def _step():
    chex.clear_trace_counter()
    return jax.jit(chex.assert_max_traces(lambda s, a: jax.vmap(_env().step)(s, a), n=1))


@pytest.fixture(scope="module")
def starts():
    return _reset()(jax.random.split(jax.random.key(0), LANES))


def _lane(states, i):
    return jax.tree.map(lambda x: x[i], states)


# ---------------------------------------------------------------- stages


@functools.cache
def _state_of():
    env = _env()

    def made(arm, joints, opening):
        start = Start(joints, jnp.asarray(BOX), jnp.zeros((), bool))
        return env.reset_to(arm, start, opening=opening)

    return jax.jit(made)


def _made(a="out", b="far", angle=0.0, arm=ASIDE, opening=0.04):
    free = [np.array([*SHOES[s], 1, 0, 0, 0], np.float32) for s in (a, b)]
    joints = np.concatenate([[angle], *free]).astype(np.float32)
    return _state_of()(jnp.asarray(arm), jnp.asarray(joints), jnp.float32(opening))


def _flags(state):
    return [int(state.metrics[f"stage {name}"]) for name in _env().stage_names]


@pytest.mark.parametrize(
    ("a", "b", "angle", "flags"),
    [
        ("out", "far", 0.0, [0, 0, 0]), ("out", "far", 1.5, [0, 0, 0]),
        ("out", "far", 1.6, [1, 0, 0]), ("in", "far", 2.6, [1, 1, 0]),
        ("out", "in", 2.6, [1, 0, 1]), ("in", "beside", 2.6, [1, 1, 1]),
        ("in", "on top", 2.6, [1, 1, 1]), ("in", "above", 2.6, [1, 1, 0]),
    ],
)  # fmt: skip
def test_stages_hold_where_they_should(a, b, angle, flags):
    state = _made(a, b, angle)
    assert _flags(state) == flags
    assert state.data.record.stage_time.tolist() == [f - 1 for f in flags]
    assert float(state.metrics["score"]) == pytest.approx(sum(flags) / 3)


def test_progress_grows_with_the_lid_and_with_the_way_to_the_box():
    angles = [float(_made(angle=x).reward) for x in (0.0, 0.5, 1.0, 1.5)]
    assert angles == sorted(angles)
    assert angles[-1] - angles[0] == pytest.approx(0.25 * 1.5 / 1.6, abs=0.03)  # the lip leaves
    # The bonus of the stages that hold at once is paid too.
    near, far = (float(_made(a, "far", 2.6).reward) for a in ("in", "out"))
    assert near > far


def test_a_shoe_between_the_pads_is_neither_in_nor_free():
    goal = np.array([0.46, -0.19, 0.06], np.float32)
    arm = jnp.asarray(ASIDE)
    frame = scenes.kinematics.tcp(arm)
    for i in range(1, 21):  # the hand goes down into the box
        place = frame.position + (goal - frame.position) * i / 20
        arm = scenes.reach()(arm, frame._replace(position=place))
    held = _made("in", "far", 2.6, arm=np.asarray(arm), opening=0.0325)
    free = _made("in", "far", 2.6, arm=np.asarray(arm), opening=0.04)
    assert _flags(held) == [1, 0, 0]
    assert _flags(free) == [1, 1, 0]


# ---------------------------------------------------------------- C MuJoCo


def test_boxes_are_where_mujoco_has_the_bodies(starts):
    start = jax.device_get(_lane(starts, 3))
    model, motion = _env().physics.mj_model, start.data.motion
    data, qpos = mujoco.MjData(model), motion.qpos.copy()
    qpos[9] = 1.1
    data.qpos[:] = qpos
    data.mocap_pos[:], data.mocap_quat[:] = np.split(start.data.fixtures, [3], axis=1)
    mujoco.mj_forward(model, data)
    seen = start.data._replace(motion=motion._replace(qpos=qpos))
    boxes = _env().world_boxes(jax.tree.map(jnp.asarray, seen))
    lid = data.body("lid")
    turn = lid.xmat.reshape(3, 3)
    np.testing.assert_allclose(boxes.rotation[4], turn, atol=1e-5)
    np.testing.assert_allclose(boxes.position[4], lid.xpos + turn @ scene.LID_CENTER, atol=1e-5)
    for i, name in enumerate(("shoe_a", "shoe_b"), start=5):
        np.testing.assert_allclose(boxes.position[i], data.body(name).xpos, atol=1e-5)
    np.testing.assert_allclose(boxes.position[3, :2], start.data.fixtures[0, :2], atol=1e-6)


def test_a_held_shoe_hardly_creeps(starts):
    hand = Hand(_env(), _lane(starts, 2))
    scene.take(hand, scene.draw_style(np.random.default_rng(0)), 0)
    hand.rest(20)
    height = float(hand.qpos[12])
    hand.rest(40)
    assert height > 0.1
    assert abs(hand.qpos[12] - height) < 0.004


# ---------------------------------------------------------------- MJX


def _follow(actions, starts):
    """States of MJX under each lane's own actions."""
    length = max(map(len, actions))
    held = [
        np.concatenate([a, np.tile(a[-1] * [0, 0, 0, 0, 1], (length - len(a), 1))]) for a in actions
    ]
    states = [starts]
    for action in np.stack(held, axis=1).astype(np.float32):
        states.append(_step()(states[-1], jnp.asarray(action)))
    return states


def _bounded(states, limit):
    for state in states:
        floats = [x for x in jax.tree.leaves(state) if jnp.issubdtype(x.dtype, jnp.floating)]
        assert all(np.isfinite(x).all() for x in floats)
    shoes = np.asarray(states[-1].data.motion.qpos[:, 10:]).reshape(LANES, 2, 7)[:, :, :3]
    assert np.abs(shoes).max() < limit


def _play(starts, steps, seed=0):
    """Random actions in half of the lanes, extreme ones in the other."""
    rng = np.random.default_rng(seed)
    states = [starts]
    for _ in range(steps):
        action = rng.uniform(-1, 1, (LANES, 5))
        action[::2] = np.sign(action[::2]) * 3
        states = [states[-1], _step()(states[-1], jnp.asarray(action, jnp.float32))]
        yield states[-1]


def test_a_step_keeps_the_structure_that_reset_made(starts):
    after = _step()(starts, jnp.zeros((LANES, 5)))
    shapes = lambda tree: jax.tree.map(lambda x: (x.shape, x.dtype), tree)  # noqa: E731
    assert shapes(starts) == shapes(after)
    assert not any(leaf.weak_type for leaf in jax.tree.leaves(after))
    assert set(starts.metrics) == set(after.metrics)
    assert (np.asarray(after.data.time) == 1).all()


def test_a_box_that_is_full_at_five_moments_is_a_success():
    lanes = [_made("in", "beside", 2.6), _made("in", "far", 2.6)] * (LANES // 2)
    states = [jax.tree.map(lambda *x: jnp.stack(x), *lanes)]
    open_hand = jnp.zeros((LANES, 5)).at[:, 4].set(1.0)
    for _ in range(6):
        states.append(_step()(states[-1], open_hand))
    assert [float(state.metrics["success"][0]) for state in states[3:5]] == [0, 1]
    found = np.asarray(states[-1].metrics["success"])
    assert found.tolist() == [1, 0] * (LANES // 2)
    assert float(states[-1].metrics["score"][0]) == 1


# ---------------------------------------------------------------- longer


@pytest.mark.slow
def test_an_experts_whole_episode_replayed_in_mjx_ends_alike(starts):
    plays = [scenes.box_filled(_env(), _lane(starts, i), i) for i in range(LANES)]
    actions = [np.array(play.actions) for play in plays]
    states = _follow(actions, starts)
    gaps = []
    for i, (play, played) in enumerate(zip(plays, actions, strict=True)):
        ours = np.asarray(states[len(played)].data.motion.qpos[i])[10:].reshape(2, 7)[:, :3]
        gaps.append(np.abs(ours - play.qpos[10:].reshape(2, 7)[:, :3]).max())
    filled = np.asarray(states[-1].metrics["score"])
    assert np.median(gaps) < 0.01
    assert (filled == 1).mean() >= 0.75


@pytest.mark.slow
def test_a_thousand_random_and_extreme_actions_leave_everything_finite(starts):
    for state in _play(starts, 1000, seed=1):
        last = state
        assert np.isfinite(state.obs).all()
    _bounded([last], limit=100.0)
