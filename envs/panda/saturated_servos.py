"""Servos at their force limit, integrated by MJX as C MuJoCo does.

The integrator "implicitfast" takes the damping of a servo (its force falls by kv for each rad/s) as
implicit. C MuJoCo leaves it out for a servo that is at the limit of its force, which does not
change with the speed then, and since February 2026 MuJoCo Warp does (its pull request 1149); MJX
(3.17) does not, so that its arm is too slow whenever it is driven hard. Here such a servo is made a
constant force for the substep.
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float, Int


def driven(model: mujoco.MjModel) -> tuple[Int[np.ndarray, "U"], Int[np.ndarray, "U"]]:
    """Indices of the joints that U servos each drive, among positions and among velocities.

    Raises:
      ValueError: an actuator drives something else, by a gear, or has no limit to its force.
    """
    joint = model.actuator_trnid[:, 0]
    of_joints = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
    direct = (model.actuator_gear[:, 0] == 1).all()
    if not (of_joints and direct and model.actuator_forcelimited.all()):
        raise ValueError("each actuator must drive a joint without a gear, its force limited")
    return model.jnt_qposadr[joint], model.jnt_dofadr[joint]


def constant_where_saturated(
    model, at, qpos: Float[Array, "Q"], qvel: Float[Array, "V"], aim: Float[Array, "U"]
):
    """The `mjx.Model` for a substep from `qpos` and `qvel`, its saturated servos constant forces.

    `at` are the joints that `driven` returns, `aim` the servos' aims.
    """
    low, high = model.actuator_ctrlrange.T
    control = jnp.where(model.actuator_ctrllimited, jnp.clip(aim, low, high), aim)
    gain, bias = model.actuator_gainprm, model.actuator_biasprm
    force = gain[:, 0] * control + bias[:, 0]
    force += bias[:, 1] * qpos[at[0]] + bias[:, 2] * qvel[at[1]]
    least, most = model.actuator_forcerange.T
    saturated = ((force <= least) | (force >= most))[:, None]
    constant = jnp.zeros_like(bias).at[:, 0].set(jnp.clip(force, least, most))
    return model.replace(
        actuator_gainprm=jnp.where(saturated, 0.0, gain),
        actuator_biasprm=jnp.where(saturated, constant, bias),
    )
