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
from gril_jax.envs.panda.kinematics import Frame, out_of, rotation
from gril_jax.envs.tabletop import boxes as cameras
from gril_jax.envs.tabletop.moves import Hand
from gril_jax.envs.tabletop.start import Start
from gril_jax.envs.tabletop.tasks import shoe_box
from gril_jax.envs.tabletop.tasks.shoes_in_box import BOX, LID, LID_CURVE, ROBOTS, SHOES
from support import tabletop_scenes as scenes

from gril_jax import envs

LANES = 8
BOX_AT = np.array([[0.493, -0.15, 0, 1, 0, 0, 0]], np.float32)
PLACES = {
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
        start = Start(joints, jnp.asarray(BOX_AT), jnp.zeros((), bool))
        return env.reset_to(arm, start, opening=opening)

    return jax.jit(made)


def _made(a="out", b="far", angle=0.0, arm=ASIDE, opening=0.04):
    free = [np.array([*PLACES[s], 1, 0, 0, 0], np.float32) for s in (a, b)]
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
    np.testing.assert_allclose(boxes.position[4], lid.xpos + turn @ shoe_box.LID_CENTER, atol=1e-5)
    for i, name in enumerate(("shoe_a", "shoe_b"), start=5):
        np.testing.assert_allclose(boxes.position[i], data.body(name).xpos, atol=1e-5)
    np.testing.assert_allclose(boxes.position[3, :2], start.data.fixtures[0, :2], atol=1e-6)


def test_a_held_shoe_hardly_creeps(starts):
    hand = Hand(_env(), _lane(starts, 2))
    shoe_box.take(hand, shoe_box.draw_style(np.random.default_rng(0)), 0)
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


# --- Stages of shoes in the box by boxes alone, beside the simulator's view of the same scenes

COUNT = 64
INSIDE = np.array(shoe_box.FLOOR_HALF) - 0.04


@pytest.fixture(scope="module")
def env():
    return envs.make("shoes_in_box")


@pytest.fixture(scope="module")
def seen(env):
    """(angle of the hinge, both shoes on the floor of the box or not) -> boxes of 64 starts."""
    starts = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), COUNT)).data

    @jax.jit
    @jax.vmap
    def look(data, angle, inside, place):
        base = Frame(data.fixtures[0, :3], rotation(data.fixtures[0, 3:]))
        qpos = data.motion.qpos.at[9].set(angle)
        for i in range(2):
            at = jnp.append(place[i] * INSIDE, shoe_box.SHOE_HALF[2])
            there = qpos.at[10 + 7 * i : 13 + 7 * i].set(out_of(base, at))
            qpos = jnp.where(inside, there, qpos)
        moved = data._replace(motion=data.motion._replace(qpos=qpos))
        return cameras.project(env.camera, env.world_boxes(moved))

    places = np.random.default_rng(0).uniform(-1, 1, (COUNT, 2, 2)).astype(np.float32)

    def boxes(angle=0.0, inside=False):
        return look(starts, jnp.full(COUNT, angle), jnp.full(COUNT, inside), places)

    return boxes


def _done(env, boxes):
    return np.asarray(jax.vmap(env.stages.done)(*boxes))


def test_the_environment_offers_them_with_the_names_of_its_own(env):
    assert tuple(stage.name for stage in env.stages.stages) == env.stage_names
    assert (env.classes[BOX], env.classes[LID]) == ("box", "lid")
    assert [env.classes[i] for i in SHOES] == ["shoe A", "shoe B"]
    assert (env.stages.robots, env.stages.movable) == (ROBOTS, (LID, *SHOES))


def test_nothing_is_done_at_the_start_and_all_with_both_shoes_in_the_open_box(env, seen):
    assert not _done(env, seen()).any()
    assert _done(env, seen(2.55, inside=True)).mean(axis=0).min() > 0.9
    boxes = seen(0.0, inside=True)
    assert not _done(env, boxes).any()  # shoes come after the lid
    progress = jax.vmap(env.stages.progress)(*boxes)
    np.testing.assert_allclose(np.median(progress), 2 / 3, atol=1e-6)


@pytest.mark.parametrize(("angle", "is_open"), [(0.5, False), (1.2, False), (2.0, True)])
def test_the_lid_is_open_beyond_a_right_angle(env, seen, angle, is_open):
    assert (_done(env, seen(angle))[:, 0] == is_open).mean() > 0.95


@pytest.mark.parametrize(("angle", "place", "shares"), LID_CURVE)
def test_the_curve_is_what_the_camera_sees(seen, angle, place, shares):
    (center, size), closed = seen(angle), seen()[1]
    found = (center[:, LID] - center[:, BOX]) / size[:, BOX]
    np.testing.assert_allclose(np.mean(found, axis=0), place, atol=0.03)
    np.testing.assert_allclose(np.mean(size[:, LID] / closed[:, LID], axis=0), shares, atol=0.05)


def test_sizes_are_those_of_the_lids_angle_and_unchanged_at_the_start(env, seen):
    center, start = seen()
    found = jax.vmap(env.stages.sizes)(center, start)
    others = jnp.array([i for i in range(7) if i != LID])
    np.testing.assert_array_equal(found[:, others], start[:, others])
    np.testing.assert_allclose(found[:, LID], start[:, LID], rtol=0.02)
    center, size = seen(2.5)
    error = jax.vmap(env.stages.sizes)(center, start)[:, LID] / size[:, LID] - 1
    assert jnp.median(jnp.abs(error)) < 0.15  # a turned box has other sizes than the mean one
    slope = jax.jacobian(env.stages.sizes)(center[0], start[0])
    assert jnp.isfinite(slope).all()
    assert jnp.abs(slope).max() > 0
