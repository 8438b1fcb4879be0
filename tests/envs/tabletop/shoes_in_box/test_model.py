"""The scene of the shoe tasks: what can touch, and what its boxes are."""

import mujoco
import numpy as np
import pytest
from gril_jax.envs.tabletop.physics import Physics, build, mjx
from gril_jax.envs.tabletop.tasks import shoe_box as scene


@pytest.fixture(scope="module")
def model():
    return build(scene.scene(), timestep=0.005, iterations=4, ls_iterations=6, max_contacts=24)


def test_every_pair_is_one_that_mjx_serves_and_contacts_are_capped(model):
    """A pair that it does not serve, or a model edit that adds contacts, shows here."""
    # Raises for what MJX has no collider for.
    physics = Physics(model, substeps=10, impl="jax", worlds=1)
    data = mjx.make_data(physics._model)
    assert model.npair == 33
    assert data._impl.contact.dist.shape == (24,)
    assert data._impl.efc_J.shape == (108, 22)


def test_joints_are_the_arms_then_the_hinge_then_two_free_ones(model):
    kinds = [int(kind) for kind in model.jnt_type[9:]]
    hinge, free = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE
    assert kinds == [int(hinge), int(free), int(free)]
    assert model.nmocap == 1
    np.testing.assert_allclose(model.jnt_range[9], scene.LID_RANGE)


def test_masses_are_those_of_the_things(model):
    masses = [model.body(name).mass[0] for name in ("shoe_a", "shoe_b", "lid")]
    np.testing.assert_allclose(masses, [0.25, 0.25, 0.4])


def test_the_constants_bound_the_geoms(model):
    data = mujoco.MjData(model)
    data.mocap_pos[:], data.mocap_quat[:] = 0.0, [1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    low = high = None
    for name in ("wall_front", "wall_back", "wall_left", "wall_right"):
        center, half = data.geom(name).xpos, model.geom(name).size
        low = center - half if low is None else np.minimum(low, center - half)
        high = center + half if high is None else np.maximum(high, center + half)
    np.testing.assert_allclose((high - low) / 2, scene.BOX_HALF, atol=1e-9)
    lip = data.geom("lip").xpos
    np.testing.assert_allclose(lip, np.array(scene.HINGE) + scene.LIP, atol=1e-9)
    edge = scene.LID_CENTER[1] + scene.LID_HALF[1]
    assert edge == pytest.approx(scene.LIP[1] + 0.006)
