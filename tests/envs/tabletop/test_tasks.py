"""Laws of all tasks at the table: starts, experts, failures, stages, physics.

A task's environment and its starts are made once, and serve the whole file.
"""

import functools
import itertools
import pkgutil

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.envs.tabletop.boxes import project
from gril_jax.envs.tabletop.moves import Hand
from gril_jax.envs.tabletop.physics import mjx
from gril_jax.envs.tabletop.recorded import EARLY

from gril_jax import envs

TASKS = (
    "shoes_in_box", "rubbish_in_bin", "umbrella_out", "item_in_drawer", "shoes_out_of_box",
    "empty_container",
)  # fmt: skip
LANES = 8


@functools.cache
def _entry(name):
    return pkgutil.resolve_name(f"gril_jax.envs.tabletop.tasks.{name}:ENTRY")


@functools.cache
def _env(name):
    return envs.make(name)


@functools.cache
def _starts(name):
    reset = jax.jit(jax.vmap(_env(name).reset))
    return jax.device_get(reset(jax.random.split(jax.random.key(0), LANES)))


def _start(name, lane):
    return jax.tree.map(lambda x: x[lane], _starts(name))


@functools.cache
def _success(name, lane=0):
    return _entry(name).script.play(_env(name), _start(name, lane), lane)


def _kinds():
    return [
        (name, kind)
        for name in TASKS
        for kind in _entry(name).script.kinds
        if kind not in ("success", EARLY)
    ]


@functools.cache
def _look(name):
    stages = _env(name).stages
    return jax.jit(lambda *boxes: (stages.done(*boxes), stages.faulty(*boxes)))


def _seen(name, run, moment):
    """Stages and faults as seen in a picture of one moment."""
    return jax.device_get(_look(name)(run.center[moment], run.size[moment]))


# ---------------------------------------------------------------- starts and the model


@pytest.mark.parametrize("name", TASKS)
def test_starts_are_random_at_rest_and_done_in_nothing(name):
    data = _starts(name).data
    assert not data.unplaced.any()
    assert not data.motion.qvel.any()
    assert (data.record.stage_time < 0).all()
    spread = np.ptp(data.motion.qpos, axis=0)
    assert (spread[:7] > 0.01).all()  # the arm
    assert spread[9:].max() > 0.05  # the things
    assert np.ptp(data.fixtures, axis=0)[:, :2].min() > 0.02


@pytest.mark.parametrize("name", TASKS)
def test_things_at_a_start_lie_still_in_c_mujoco(name):
    """A start that puts one thing into another would throw it away.

    Origins alone: a leaning umbrella still turns a little about its tip.
    """
    model = _env(name).physics.mj_model
    things = model.jnt_bodyid[9:]  # of the joints after the arm's
    data = mujoco.MjData(model)
    for lane in range(4):
        start = _start(name, lane)
        hand = Hand(_env(name), start)
        hand.rest(10)
        places = []
        for qpos in (hand.positions[0], hand.positions[-1]):
            data.qpos[:] = qpos
            data.mocap_pos[:], data.mocap_quat[:] = np.split(start.data.fixtures, [3], axis=1)
            mujoco.mj_kinematics(model, data)
            places.append(data.xpos[things].copy())
        assert np.abs(places[1] - places[0]).max() < 0.01, lane


@pytest.mark.parametrize("name", TASKS)
def test_only_listed_pairs_touch_and_mjx_has_room_for_the_task_s_contacts(name):
    env = _env(name)
    model = env.physics.mj_model
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    data = mjx.make_data(env.physics._model)
    assert data._impl.contact.dist.shape == (env.task.max_contacts,)


# ---------------------------------------------------------------- the expert


@pytest.mark.parametrize("name", TASKS)
def test_the_expert_succeeds_and_stops_within_half_a_second(name):
    for lane in range(2):
        run = _success(name, lane)
        assert _entry(name).script.as_meant(run)
        assert run.success[-1]
        assert len(run.qpos) <= run.success.argmax() + 11
        assert run.stages[-1].all()
        assert (run.stage_time > 0).all()
        assert run.boxes.position.shape == (len(run.qpos), len(_env(name).classes), 3)


@pytest.mark.parametrize("name", ["shoes_in_box", "item_in_drawer", "shoes_out_of_box"])
def test_what_is_shut_is_opened_first(name):
    run = _success(name)
    assert run.stage_time[0] < run.stage_time[1:].min()


@pytest.mark.parametrize(
    "name", [*TASKS[:2], *(pytest.param(name, marks=pytest.mark.slow) for name in TASKS[2:])]
)
def test_the_same_seed_plays_the_same_and_another_one_does_not(name):
    script, first = _entry(name).script, _success(name)
    np.testing.assert_array_equal(script.play(_env(name), _start(name, 0), 0).qpos, first.qpos)
    other = script.play(_env(name), _start(name, 0), 5)
    assert len(other.qpos) != len(first.qpos) or not np.array_equal(other.qpos, first.qpos)


@pytest.mark.parametrize(("name", "kind"), _kinds())
def test_each_failure_is_what_its_name_says_and_no_success(name, kind):
    script = _entry(name).script
    plays = (script.play(_env(name), _start(name, lane), lane, kind) for lane in range(3))
    meant = [*itertools.islice((run for run in plays if script.as_meant(run)), 2)]
    assert len(meant) == 2
    assert not any(run.success.any() for run in meant)
    success = _success(name)._replace(kind=kind)
    assert not script.as_meant(success)


@pytest.mark.parametrize("name", TASKS)
def test_a_task_has_five_kinds_of_failures_and_one_that_stops_early(name):
    script = _entry(name).script
    assert script.kinds[0] == "success"
    assert len(script.kinds) >= 6
    run = script.play(_env(name), _start(name, 1), 1, EARLY)
    assert script.as_meant(run)
    assert len(run.qpos) < len(_success(name, 1).qpos)


# ---------------------------------------------------------------- stages in a picture


@pytest.mark.parametrize("name", TASKS)
def test_stages_by_boxes_hold_at_the_end_of_a_success_and_not_at_its_start(name):
    for lane in range(2):
        run = _success(name, lane)
        assert not _seen(name, run, 0)[0].any()
        done, faults = _seen(name, run, -1)
        assert done.all()
        assert not faults.any()


@pytest.mark.parametrize("name", TASKS)
def test_a_stage_that_is_placed_holds(name):
    """Their order by boxes is that of the task, and a success can be made of any start."""
    stages, objects = _env(name).stages, _starts(name).objects
    assert tuple(stage.name for stage in stages.stages) == _env(name).stage_names
    keys = jax.random.split(jax.random.key(1), LANES)

    def fulfilled(key, center, size):
        return stages.progress(stages.fulfil(key, center, size), size)

    progress = jax.jit(jax.vmap(fulfilled))(keys, objects.center, objects.size)
    assert np.mean(np.asarray(progress) == 1) >= 0.75, progress


def test_a_tomato_in_the_bin_is_a_fault_and_no_success():
    name = "rubbish_in_bin"
    script = _entry(name).script
    run = script.play(_env(name), _start(name, 0), 0, "tomato too")
    done, faults = _seen(name, run, -1)
    assert done.all()
    assert faults.sum() == 1
    assert run.stages[-1].all()
    assert not run.success.any()


# ---------------------------------------------------------------- extreme actions


@pytest.mark.parametrize("name", TASKS)
def test_a_second_of_extreme_actions_is_finite_in_c_mujoco(name):
    rng = np.random.default_rng(0)
    for lane in range(2):
        hand = Hand(_env(name), _start(name, lane))
        for _ in range(20):
            hand.act(rng.choice([-1.0, 1.0], _env(name).action_size))
        assert np.isfinite(hand.qpos).all()
        assert np.abs(hand.qpos[:9]).max() < 4  # joints stay near their ranges


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_an_episode_of_extreme_actions_is_finite_in_mjx(name):
    env = _env(name)
    state = jax.jit(env.reset)(jax.random.key(0))
    step = jax.jit(env.step)
    for key in jax.random.split(jax.random.key(1), 60):
        state = step(state, jax.random.choice(key, jnp.array([-1.0, 1.0]), (env.action_size,)))
        leaves = [x for x in jax.tree.leaves(state) if jnp.issubdtype(x.dtype, jnp.floating)]
        assert all(jnp.isfinite(leaf).all() for leaf in leaves)


def test_of_an_umbrella_in_its_stand_the_part_above_the_rim_is_seen():
    env, start = _env("umbrella_out"), _start("umbrella_out", 0)
    look = jax.jit(lambda data: (*env.picture_boxes(data), env.world_boxes(data)))

    def lifted(height):
        motion = start.data.motion
        qpos = motion.qpos.copy()
        qpos[11] += height
        center, size, boxes = look(start.data._replace(motion=motion._replace(qpos=qpos)))
        return np.asarray(center)[4], np.asarray(size)[4], jax.tree.map(lambda x: x[4:5], boxes)

    _, whole, boxes = lifted(0.3)
    np.testing.assert_allclose(whole, project(env.camera, boxes)[1][0], rtol=1e-5)
    heights = [lifted(height)[1][1] for height in (0.0, 0.05, 0.1, 0.15)]
    assert heights[0] < 0.35 * whole[1]
    assert (np.diff(heights) > 0.03).all()


def test_the_stages_of_a_drawer_keep_it_on_its_rail():
    """Shut and open drawers of the simulator are where the rail says that they can be."""
    env = _env("item_in_drawer")
    boxes = jax.jit(jax.vmap(env.picture_boxes))

    def off(travel):
        motion = _starts("item_in_drawer").data.motion
        qpos = motion.qpos.copy()
        qpos[:, 9] = travel
        data = _starts("item_in_drawer").data._replace(motion=motion._replace(qpos=qpos))
        center, size = boxes(data)
        return np.abs(jax.vmap(env.stages.possible)(center, size) - center).max()

    assert max(off(travel) for travel in (0.0, 0.1, 0.22)) < 1e-5
