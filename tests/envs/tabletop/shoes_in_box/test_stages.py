"""Stages of shoes in the box by boxes alone, beside the simulator's view of the same scenes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import make
from gril_jax.envs.panda.kinematics import Frame, out_of, rotation
from gril_jax.envs.tabletop import boxes as cameras
from gril_jax.envs.tabletop.tasks import shoe_box
from gril_jax.envs.tabletop.tasks.shoes_in_box import BOX, LID, LID_CURVE, ROBOTS, SHOES

COUNT = 64
INSIDE = np.array(shoe_box.FLOOR_HALF) - 0.04


@pytest.fixture(scope="module")
def env():
    return make("shoes_in_box")


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
