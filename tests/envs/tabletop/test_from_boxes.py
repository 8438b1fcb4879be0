"""A table read from its boxes: the inverse of the camera, and things that lie clear of each other.

One compiled placement serves most of the file: compiling takes most of its time.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.panda import kinematics
from gril_jax.envs.panda.kinematics import Frame
from gril_jax.envs.tabletop import resting
from gril_jax.envs.tabletop.boxes import touching
from gril_jax.envs.tabletop.moves import CLOSED, OPEN, Hand
from gril_jax.envs.tabletop.resting import Space, put_down
from gril_jax.envs.tabletop.start import Footprint, Start, free_joint, reach
from gril_jax.envs.tabletop.tasks import shoe_box

from gril_jax import envs

HALF = jnp.array([shoe_box.SHOE_HALF] * 2)
SPACE = Space(0, shoe_box.FLOOR_HALF, shoe_box.BOX_HALF[:2])
BASE = jnp.array([[0.5, -0.15, 0.2]])


@functools.cache
def _env():
    return envs.make("shoes_in_box", observation="plain", jitter=1.0)


@functools.cache
def _place():
    return jax.jit(jax.vmap(_env().place_held))


@functools.cache
def _shown():
    """States with given joints and fixtures, the robot at home."""
    env = _env()

    def show(joints, fixtures, opening):
        start = Start(joints, fixtures, jnp.zeros((), bool))
        return env.reset_to(jnp.asarray(env.task.home), start, opening=opening)

    return jax.jit(jax.vmap(show))


@functools.cache
def _scenes():
    """Eight starts of the task, in four of which the lid is open, and a shoe or two in the box."""
    states = jax.jit(jax.vmap(_env().reset))(jax.random.split(jax.random.key(3), 8))
    joints = np.array(states.data.motion.qpos[:, 9:])
    fixtures = np.array(states.data.fixtures)
    for lane, inside in ((4, ()), (5, (0,)), (6, (1,)), (7, (0, 1))):
        joints[lane, 0] = shoe_box.LID_RANGE[1]
        x, y = fixtures[lane, 0, :2]
        yaw = 2 * np.arctan2(fixtures[lane, 0, 6], fixtures[lane, 0, 3])
        for shoe in inside:
            aside = (-0.05, 0.06)[shoe]
            spot = [x - np.sin(yaw) * aside, y + np.cos(yaw) * aside, yaw + 0.05]
            pose = free_joint(jnp.array([spot]), shoe_box.SHOE_HALF[2])
            joints[lane, 1 + 7 * shoe : 8 + 7 * shoe] = pose
    return _shown()(joints, fixtures, np.full(8, 0.04, np.float32))


def _placed(objects, key=0, held=()):
    count = len(objects.center)
    keys = jax.random.split(jax.random.key(key), count)
    known = np.isin(np.arange(objects.center.shape[1]), held)
    return _place()(objects.center, objects.size, keys, np.tile(known, (count, 1)))


def _poses(state):
    return state.data.motion.qpos[:, 10:].reshape(-1, 2, 7)


def test_a_state_is_found_again_from_its_boxes():
    true, found = _scenes(), _placed(_scenes().objects)
    np.testing.assert_allclose(
        found.data.fixtures[:, 0, :2], true.data.fixtures[:, 0, :2], atol=2e-3
    )
    np.testing.assert_allclose(_poses(found)[..., :3], _poses(true)[..., :3], atol=0.012)
    np.testing.assert_allclose(found.data.motion.qpos[:, 9], true.data.motion.qpos[:, 9], atol=1e-3)
    np.testing.assert_allclose(found.objects.center[:, 3:], true.objects.center[:, 3:], atol=0.02)
    np.testing.assert_allclose(found.objects.size[:, 3:], true.objects.size[:, 3:], atol=0.04)
    assert not found.data.motion.qvel.any()


def test_a_lid_that_is_half_open_falls_to_the_side_where_it_is():
    data = _scenes().data
    joints = np.array(data.motion.qpos[:, 9:])
    joints[:, 0] = [0.3, 0.8, 1.2, 1.4, 1.75, 2.0, 2.3, 2.6]
    seen = _shown()(joints, data.fixtures, np.full(8, 0.04, np.float32))
    lids = _placed(seen.objects).data.motion.qpos[:, 9]
    np.testing.assert_allclose(lids, np.repeat(np.array(shoe_box.LID_RANGE, np.float32), 4))


@functools.cache
def _carried():
    """The same scenes; in the first four the hand holds a shoe, in the others one hangs alone."""
    env, data = _env(), _scenes().data
    hand = env.view(jax.tree.map(lambda x: x[0], data)).hand.position
    joints = np.array(data.motion.qpos[:, 9:])
    joints[:4, 1:4] = hand
    joints[4:, 1:4] = hand + np.array([0.1, 0.2, 0.0])
    return _shown()(joints, data.fixtures, np.full(8, shoe_box.SHOE_HALF[1], np.float32))


def test_what_the_hand_holds_stays_in_it_and_what_hangs_alone_lies():
    true, found = _carried(), _placed(_carried().objects)
    held = np.arange(8) < 4
    np.testing.assert_array_equal(found.data.target[:, 7] < 0, held)
    np.testing.assert_allclose(_poses(found)[held, 0, :3], _poses(true)[held, 0, :3], atol=0.012)
    np.testing.assert_allclose(_poses(found)[~held, :, 2], shoe_box.SHOE_HALF[2], atol=1e-6)
    for lane in range(8):
        play = Hand(_env(), jax.tree.map(lambda x, i=lane: x[i], found))
        play.grip = CLOSED if held[lane] else OPEN
        play.rest(20)
        moved = play.positions[-1][10:].reshape(2, 7) - play.positions[0][10:].reshape(2, 7)
        assert np.abs(moved[:, :3]).max() < 0.01
        assert np.abs(play.velocities[-1][9:]).max() < 0.05


def test_what_a_video_knows_to_be_held_is_in_the_hand_wherever_its_box_is():
    shoe, seen = _env().classes.index("shoe A"), _carried().objects
    center, size = np.array(seen.center), np.array(seen.size)
    center[:, shoe], size[:, shoe] = (x[:, shoe] for x in _scenes().objects[:2])
    unseen = seen._replace(center=center, size=size)  # the boxes are those before it was taken
    assert (_placed(unseen).data.target[:4, 7] > 0).all()
    found = _placed(unseen, held=(shoe,))
    assert (found.data.target[:4, 7] < 0).all()
    away = _poses(found)[:4, 0, :3] - _poses(_carried())[:4, 0, :3]
    assert np.linalg.norm(away, axis=1).max() < 0.04


def test_of_two_that_are_said_to_be_held_the_first_is():
    first, second = (_env().classes.index(f"shoe {name}") for name in "AB")
    seen = _carried().objects
    one, both = (_placed(seen, held=held) for held in ((first,), (first, second)))
    np.testing.assert_allclose(both.objects.center, one.objects.center, atol=1e-4)


def test_the_hand_is_where_it_is_seen_and_above_what_it_would_touch():
    env, data = _env(), _scenes().data
    tool = lambda state: jax.vmap(kinematics.tcp)(state.data.motion.qpos[:, :7]).position  # noqa: E731
    np.testing.assert_allclose(tool(_placed(_scenes().objects)), tool(_scenes()), atol=0.015)
    # Down between the shoes, where its fingers would be within one.
    low = np.array(data.motion.qpos[:, 10:13]) + np.array([0.0, 0.0, 0.02])
    home = jnp.asarray(env.task.home)

    @jax.jit
    @jax.vmap
    def between(place, joints, fixtures):
        arm = kinematics.reach(home, Frame(place, jnp.diag(jnp.array([1.0, -1, -1]))), rest=home)
        return env.reset_to(arm, Start(joints, fixtures, jnp.zeros((), bool)), opening=0.01)

    @jax.jit
    @jax.vmap
    def touch(data):
        every = env.world_boxes(data)
        robot, things = (jax.tree.map(lambda x, s=s: x[s], every) for s in (slice(3), slice(3, 7)))
        things, _ = resting._hollow(things, env.task.layout, jnp.zeros(4, bool))
        return jax.vmap(jax.vmap(touching, (None, 0)), (0, None))(robot, things)

    seen = between(low, data.motion.qpos[:, 9:], data.fixtures)
    assert not touch(_placed(seen.objects).data).any()


def test_whatever_the_boxes_are_the_state_is_finite():
    seen = _scenes().objects
    bad = np.array(seen.center), np.array(seen.size)
    bad[0][0, 4, 0], bad[1][1, 5, 1] = np.nan, np.inf
    bad[1][2], bad[0][3], bad[0][4] = 0.0, 5.0, -1e4
    bad[0][5], bad[1][6] = 0.0, 100.0
    found = _placed(seen._replace(center=bad[0], size=bad[1]))
    for leaf in jax.tree.leaves((found.data.motion, found.obs, found.objects)):
        assert np.isfinite(leaf).all()
    own = _env().task.start(jax.random.key(0), 0.0)
    np.testing.assert_allclose(found.data.motion.qpos[0, 9:], own.joints, atol=1e-6)


def test_one_by_one_is_as_all_at_once_and_the_key_draws_nothing():
    seen, all_found = _scenes().objects, _placed(_scenes().objects)
    keys = jax.random.split(jax.random.key(0), 8)
    one = jax.jit(_env().place)  # nothing is known to be held
    for lane in (0, 7):
        found = one(seen.center[lane], seen.size[lane], keys[lane])
        np.testing.assert_allclose(
            found.data.motion.qpos, all_found.data.motion.qpos[lane], atol=2e-3
        )
    other = _placed(seen, key=1).data
    np.testing.assert_allclose(other.motion.qpos, all_found.data.motion.qpos)


@pytest.mark.parametrize(
    "task",
    [
        "empty_container",
        "item_in_drawer",
        pytest.param("rubbish_in_bin", marks=pytest.mark.slow),
        pytest.param(
            "umbrella_out",
            marks=[
                pytest.mark.slow,
                pytest.mark.xfail(strict=True, reason="at rest it is put behind the stand"),
            ],
        ),
    ],
)
def test_other_tasks_find_their_starts_again(task):
    env = envs.make(task)

    def around(key):
        true = env.reset(key)
        found = env.place(true.objects.center, true.objects.size, key)
        return true.objects.center, found.objects.center

    true, found = jax.jit(jax.vmap(around))(jax.random.split(jax.random.key(0), 8))
    assert np.abs(true - found)[:, 3:].max() < 0.02


# ---------------------------------------------------------------- what lies beside what


def _thing(x, y, yaw, half=shoe_box.SHOE_HALF[:2]):
    return Footprint(jnp.array([x, y, yaw]), jnp.array(half))


def test_a_shift_brings_things_just_clear_of_each_other():
    rng = np.random.default_rng(0)
    fixed = _thing(0.0, 0.0, 0.3)
    for x, y, yaw in rng.uniform(-0.15, 0.15, (20, 3)) * np.array([1, 1, 20]):
        shift = resting.clear(_thing(x, y, yaw), fixed)
        moved = _thing(x + shift[0], y + shift[1], yaw)
        assert np.linalg.norm(resting.clear(moved, fixed)) < 1e-5
        if np.linalg.norm(shift) > 0:  # half of it would not have been enough
            half = _thing(x + shift[0] / 2, y + shift[1] / 2, yaw)
            assert np.linalg.norm(resting.clear(half, fixed)) > 0


def test_what_is_clear_stays_where_it_is():
    places = jnp.array([[0.5, 0.12, 0.1], [0.48, -0.15, 0.2]])
    found, heights = put_down(places, HALF, (SPACE,), BASE)
    np.testing.assert_allclose(found, places, atol=1e-6)
    np.testing.assert_allclose(heights, 0.025)


def test_shoes_in_the_box_lie_within_its_walls_beside_each_other():
    places = jnp.array([[0.64, -0.13, 0.5], [0.62, -0.12, 0.2]])  # through the wall
    found, heights = put_down(places, HALF, (SPACE,), BASE)
    assert resting.over(SPACE, BASE[0], found).all()
    for place in found:  # clear of each wall, as thin things beside the floor
        local = resting._into(BASE[0], place[:2])
        thing = Footprint(place, HALF[0, :2])
        across = reach(BASE[0, 2] + jnp.array([0, np.pi / 2]), thing)
        assert (jnp.abs(local) + across <= jnp.array(shoe_box.FLOOR_HALF) + 1e-5).all()
    beside = np.linalg.norm(resting.clear(*(Footprint(p, HALF[0, :2]) for p in found))) < 1e-3
    assert beside or heights[1] > heights[0] + 0.04


def test_where_there_is_no_room_one_shoe_lies_on_the_other():
    tight = Space(0, (0.09, 0.04), (0.1, 0.05))
    _, heights = put_down(BASE.repeat(2, axis=0), HALF, (tight,), BASE)
    np.testing.assert_allclose(heights, [0.025, 0.075], atol=1e-6)
