"""Rotations against MuJoCo's and against each other."""

import jax.numpy as jnp
import mujoco
import numpy as np
from gril_jax.envs.panda import kinematics

RNG = np.random.default_rng(0)
QUATS = RNG.normal(size=(6, 4)).astype(np.float32)
QUATS /= np.linalg.norm(QUATS, axis=1, keepdims=True)


def test_rotations_are_mujocos():
    for quat in QUATS:
        matrix = np.zeros(9)
        mujoco.mju_quat2Mat(matrix, quat.astype(float))
        np.testing.assert_allclose(
            kinematics.rotation(jnp.asarray(quat)), matrix.reshape(3, 3), atol=1e-6
        )


def test_products_are_matrix_products():
    a, b = kinematics.rotation(jnp.asarray(QUATS[:3])), kinematics.rotation(jnp.asarray(QUATS[3:]))
    np.testing.assert_allclose(kinematics.compose(a, b), np.asarray(a) @ np.asarray(b), atol=1e-6)
    vector = RNG.normal(size=(3, 3)).astype(np.float32)
    wanted = np.einsum("bij,bj->bi", a, vector)
    np.testing.assert_allclose(kinematics.turned(a, jnp.asarray(vector)), wanted, atol=1e-6)


def test_into_undoes_out_of():
    place, point = RNG.normal(size=(2, 6, 3)).astype(np.float32)
    frame = kinematics.Frame(jnp.asarray(place), kinematics.rotation(jnp.asarray(QUATS)))
    back = kinematics.into(frame, kinematics.out_of(frame, jnp.asarray(point)))
    np.testing.assert_allclose(back, point, atol=2e-6)


def test_a_small_turn_is_axis_times_sine():
    start = kinematics.rotation(jnp.asarray(QUATS[0]))
    goal = kinematics.compose(kinematics.about_z(jnp.float32(0.2)), start)
    np.testing.assert_allclose(kinematics.small_turn(start, goal), [0, 0, np.sin(0.2)], atol=1e-6)
