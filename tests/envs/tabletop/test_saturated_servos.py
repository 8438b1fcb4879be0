"""Servos at their limit in MJX: a step is that of C MuJoCo, which MJX's own is not."""

import contextlib
import io

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from gril_jax.envs.tabletop.physics import constant_where_saturated, driven

with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx

# Two joints in a row, whose servos are as stiff, damped and weak as the Panda's.
ARM = """
<mujoco>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.005" integrator="implicitfast"><flag eulerdamp="disable"/></option>
  <worldbody><body><joint name="a" axis="0 1 0" armature="0.1"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0"/>
    <body pos="0.4 0 0"><joint name="b" axis="0 1 0" armature="0.1"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0"/></body></body></worldbody>
  <actuator>
    <position joint="a" kp="4500" kv="450" forcerange="-87 87" ctrlrange="-2 2"/>
    <position joint="b" kp="2000" kv="200" forcerange="-12 12"/>
  </actuator>
</mujoco>"""
AIMS = np.array([[0.0, 0.0], [0.001, -0.0005], [0.05, 0.3], [-1.5, 3.0], [9.0, -0.2]], np.float32)


def _in_c(model, aim, steps):
    data = mujoco.MjData(model)
    data.ctrl[:] = aim
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return data.qpos.copy()


def _in_mjx(model, aims, steps, *, own):
    at, compiled = driven(model), mjx.put_model(model)
    blank = mjx.make_data(compiled)

    def play(aim):
        def step(data, _):
            held = compiled
            if not own:
                held = constant_where_saturated(compiled, at, data.qpos, data.qvel, aim)
            return mjx.step(held, data), None

        return jax.lax.scan(step, blank.replace(ctrl=aim), length=steps)[0].qpos

    return np.asarray(jax.jit(jax.vmap(play))(jnp.asarray(aims)))


def test_a_step_is_that_of_c_mujoco_at_the_limit_and_below_it():
    model = mujoco.MjModel.from_xml_string(ARM)
    true = np.stack([_in_c(model, aim, 40) for aim in AIMS])
    np.testing.assert_allclose(_in_mjx(model, AIMS, 40, own=False), true, atol=2e-5)


def test_mjx_alone_is_behind():
    """If this fails, MJX has learned it, and `constant_where_saturated` has done its work."""
    model = mujoco.MjModel.from_xml_string(ARM)
    true = np.stack([_in_c(model, aim, 20) for aim in AIMS])
    gap = np.abs(_in_mjx(model, AIMS, 20, own=True) - true).max(axis=1)
    assert gap[:2].max() < 1e-5  # none is at its limit
    assert gap[3:].min() > 0.05


def test_only_saturated_servos_change():
    model = mujoco.MjModel.from_xml_string(ARM)
    compiled, at = mjx.put_model(model), driven(model)
    state = jnp.array([0.1, 0.0]), jnp.array([0.0, 0.02])  # forces 4500 (aim - 0.1), 2000 aim - 4
    held = constant_where_saturated(compiled, at, *state, jnp.array([0.5, 0.003]))
    assert held.actuator_gainprm[:, 0].tolist() == [0.0, 2000.0]
    np.testing.assert_allclose(held.actuator_biasprm[:, :3], [[87, 0, 0], [0, -2000, -200]])
    beyond = constant_where_saturated(compiled, at, *state, jnp.array([-9.0, -0.005]))
    np.testing.assert_allclose(beyond.actuator_biasprm[:, :3], [[-87, 0, 0], [-12, 0, 0]])


@pytest.mark.parametrize(
    "servo",
    ['<position joint="a" kp="9" gear="2" forcerange="-1 1"/>', '<position joint="a" kp="9"/>'],
    ids=["gear", "no limit"],
)
def test_a_servo_with_a_gear_or_without_a_limit_is_refused(servo):
    text = ARM[: ARM.index("<actuator>")] + f"<actuator>{servo}</actuator></mujoco>"
    with pytest.raises(ValueError, match="a joint without a gear, its force limited"):
        driven(mujoco.MjModel.from_xml_string(text))
