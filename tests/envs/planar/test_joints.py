"""The table, the drive and the fingers: what they aim at, and how strong they are."""

import math

import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import joints, robots
from gril_jax.envs.planar.contacts import Frames
from gril_jax.envs.planar.impulses import Bodies
from gril_jax.envs.planar.joints import Command, FingerImpulses, Servo
from gril_jax.envs.planar.plane import Vec, heading
from hypothesis import given, settings
from hypothesis import strategies as st
from support import planar_scenes

DT = 0.0125
OPEN = robots.FINGER_OPEN


def _vec(xy):
    return Vec(*jnp.asarray(xy, jnp.float32).T)


def _gripper():
    parts = robots.robot("gripper").parts
    return Bodies(jnp.array([1 / p.mass for p in parts]), jnp.array([1 / p.inertia for p in parts]))


def _aims(pose, before=None, spin=0.0, speed=0.0, turn=0.0, opening=OPEN):
    pose = jnp.asarray(pose, jnp.float32)
    before = pose if before is None else jnp.asarray(before, jnp.float32)
    place = Frames(Vec(pose[:, 0], pose[:, 1]), heading(pose[:, 2]))
    command = Command(*(jnp.float32(x) for x in (speed, turn, opening)))
    return joints.aims(before, pose, place, jnp.float32(spin), command, dt=DT)


# ---------------------------------------------------------------- the table and the drive

BLOCKS = Bodies(jnp.full(4, 100.0), jnp.full(4, 1e4))
BASE = Bodies(jnp.full(4, 1.0), jnp.full(4, 50.0))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.floats(-3, 3), st.floats(-3, 3))
def test_servos_sum_up_what_reaches_their_aim_within_their_strength(seed, force, torque):
    """The vector and the torque are clipped by themselves; the table's aim is to hold still."""
    rng, (force, torque) = np.random.default_rng(seed), 10.0 ** np.array([force, torque])
    velocity, push, wanted = rng.normal(size=(3, 4, 2)) * 10.0 ** rng.uniform(-2, 2, (3, 1, 1))
    spin, turn, rate = rng.normal(size=(3, 4)) * 10.0 ** rng.uniform(-2, 2, (3, 1))
    aim = joints.Aims(_vec(wanted), jnp.float32(rate))
    moving, given_ = (_vec(velocity), jnp.float32(spin)), Servo(_vec(push), jnp.float32(turn))
    for bodies, aimed, found in (
        (BLOCKS, (0.0, 0.0), joints.hold(*moving, given_, BLOCKS, force, torque)),
        (BASE, (wanted, rate), joints.drive(*moving, given_, aim, BASE, force, torque)),
    ):
        mass, inertia = (float(1 / f[0]) for f in bodies)
        vector, moment = push + (aimed[0] - velocity) * mass, turn + (aimed[1] - spin) * inertia
        share = np.minimum(1.0, force / np.linalg.norm(vector, axis=1, keepdims=True))
        ours = np.stack([found.push.x, found.push.y], axis=1)
        rounding = 1e-6 * share * np.abs([push, velocity, wanted]).max()
        off = np.linalg.norm(ours - share * vector, axis=1, keepdims=True)
        assert (
            off <= 1e-4 * np.linalg.norm(share * vector, axis=1, keepdims=True) + rounding
        ).all()
        held = np.clip(moment, -torque, torque)
        rounding = 1e-6 * np.abs([turn, spin, rate]).max() * (np.abs(moment) < 1.001 * torque)
        assert (np.abs(found.turn - held) <= 1e-4 * np.abs(held) + rounding).all()
        assert (np.hypot(*ours.T) <= force * (1 + 1e-5)).all()


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_the_drive_aims_at_the_speed_ahead_of_the_earlier_heading(yaw):
    pose = planar_scenes.parts("short", (0.1, 0.2, yaw + 0.03))
    aim = _aims(pose, before=planar_scenes.parts("short", (0.1, 0.2, yaw)), speed=0.6)
    assert float(aim.drive.x) == pytest.approx(-0.6 * math.sin(yaw), abs=1e-6)
    assert float(aim.drive.y) == pytest.approx(0.6 * math.cos(yaw), abs=1e-6)
    assert aim.rate is None
    assert aim.arm is None


@pytest.mark.parametrize(
    ("turn", "spin", "aimed"),
    [(0.0, 0.0, 0.0), (1.5, 0.0, 2.5), (-1.5, 0.0, -2.5), (0.0125, 0.3, 0.7), (0.0, 1.0, -1.0)],
)
def test_the_turn_servo_aims_at_what_is_left_of_the_offset_in_one_substep(turn, spin, aimed):
    aim = _aims(planar_scenes.parts("short", (0, 0, 0)), turn=turn, spin=spin)
    assert float(aim.turn) == pytest.approx(aimed, abs=1e-6)


# ---------------------------------------------------------------- the fingers


def test_open_fingers_on_their_pivots_lack_nothing():
    aim = _aims(planar_scenes.parts("gripper", (0.3, -0.2, 0.7)))
    np.testing.assert_allclose(aim.rate, 0.0, atol=1e-6)
    np.testing.assert_allclose(aim.pivot.x, 0.0, atol=1e-4)
    np.testing.assert_allclose(aim.pivot.y, 0.0, atol=1e-4)
    np.testing.assert_allclose(aim.limit, 0.0, atol=1e-4)


@pytest.mark.parametrize(
    ("now", "aimed", "rate"),
    [(OPEN, 0.0, -1.0), (0.0, OPEN, 1.0), (0.2, 0.15, -0.5), (0.2, 0.2 - 5e-5, 0.0)],
)
def test_fingers_aim_at_ten_times_their_error_up_to_one_rad_a_second(now, aimed, rate):
    aim = _aims(planar_scenes.parts("gripper", (0, 0, 0.5), now), opening=aimed)
    np.testing.assert_allclose(aim.rate, [rate, -rate], atol=1e-4)


@pytest.mark.parametrize(("opening", "back"), [(OPEN + 0.02, -0.02), (-0.01, 0.01), (0.2, 0.0)])
def test_stops_bring_a_finger_back_within_a_substep(opening, back):
    aim = _aims(planar_scenes.parts("gripper", (0, 0, 0.5), opening))
    np.testing.assert_allclose(aim.limit, [back / DT, -back / DT], atol=1e-4)


def test_a_displaced_finger_is_brought_back_onto_its_pivot_within_a_substep():
    pose = planar_scenes.parts("gripper", (0, 0, 0.5))
    pose[1, :2] += [0.01, -0.02]
    aim = _aims(pose)
    np.testing.assert_allclose(aim.pivot.x * DT, [-0.01, 0.0], atol=1e-6)
    np.testing.assert_allclose(aim.pivot.y * DT, [0.02, 0.0], atol=1e-6)


def _no_impulses():
    return FingerImpulses(Vec(jnp.zeros(2), jnp.zeros(2)), jnp.zeros(2), jnp.zeros(2))


def _random_motion(seed=0):
    rng = np.random.default_rng(seed)
    return _vec(rng.normal(size=(3, 2))), jnp.asarray(rng.normal(size=3), jnp.float32)


def test_pivots_take_away_all_relative_motion_at_them():
    pose, bodies = planar_scenes.parts("gripper", (0, 0, 0.5)), _gripper()
    aim = _aims(pose)
    # Fingers that are not too heavy for each other: one at a time is exact, both nearly.
    velocity, spin = _random_motion()
    for _ in range(30):
        velocity, spin, _ = joints.fingers(velocity, spin, _no_impulses(), aim, bodies, 0.0)
    arm = aim.arm.turned() * spin[0]
    for base, turn, finger in (
        (velocity.x[0], arm.x, velocity.x[1:]),
        (velocity.y[0], arm.y, velocity.y[1:]),
    ):
        np.testing.assert_allclose(finger, base + turn, atol=1e-3)


def test_pins_and_torques_conserve_momentum():
    pose, bodies = planar_scenes.parts("gripper", (0, 0, 0.5), 0.1), _gripper()
    aim, (velocity, spin) = _aims(pose), _random_motion(1)

    def momentum(velocity, spin):
        """Linear, and angular about the base's centre; fingers are at the ends of the arms."""
        px, py = velocity.x / bodies.inverse_mass, velocity.y / bodies.inverse_mass
        turning = jnp.sum(spin / bodies.inverse_inertia)
        return px.sum(), py.sum(), turning + jnp.sum(aim.arm.x * py[1:] - aim.arm.y * px[1:])

    before = momentum(velocity, spin)
    after = momentum(*joints.pin(velocity, spin, _vec([[0.3, -0.2], [0.1, 0.5]]), aim, bodies))
    np.testing.assert_allclose(before, after, atol=1e-5)
    turned = joints.turn_fingers(spin, jnp.array([0.02, -0.05]), bodies)
    np.testing.assert_allclose(before, momentum(velocity, turned), atol=1e-5)
    new = joints.fingers(velocity, spin, _no_impulses(), aim, bodies, 4 * DT)
    np.testing.assert_allclose(before, momentum(*new[:2]), atol=1e-5)


def test_motors_reach_their_rate_if_they_are_strong_enough():
    aim, bodies = _aims(planar_scenes.parts("gripper", (0, 0, 0.5), 0.2), opening=0.0), _gripper()
    velocity, spin, given = _vec(np.zeros((3, 2))), jnp.zeros(3), _no_impulses()
    for _ in range(60):
        velocity, spin, given = joints.fingers(velocity, spin, given, aim, bodies, 4 * DT)
    np.testing.assert_allclose(spin[1:] - spin[0], [-1.0, 1.0], atol=1e-3)


def test_motors_are_capped_over_many_sweeps():
    aim, bodies = _aims(planar_scenes.parts("gripper", (0, 0, 0.5), 0.2), opening=0.0), _gripper()
    velocity, spin, given = _vec(np.zeros((3, 2))), jnp.zeros(3), _no_impulses()
    for _ in range(10):
        velocity, spin, given = joints.fingers(velocity, spin, given, aim, bodies, 1e-3)
        assert (np.abs(given.motor) <= 1e-3 + 1e-9).all()
    np.testing.assert_allclose(given.motor, [-1e-3, 1e-3], rtol=1e-5)


def test_stops_only_push_back():
    """A finger beyond its stop that already returns fast is not held back."""
    bodies = _gripper()
    aim = _aims(planar_scenes.parts("gripper", (0, 0, 0), OPEN + 0.01))
    still = _vec(np.zeros((3, 2)))
    slow = joints.fingers(still, jnp.zeros(3), _no_impulses(), aim, bodies, 0.0)[2]
    fast = joints.fingers(still, jnp.array([0.0, -5.0, 5.0]), _no_impulses(), aim, bodies, 0.0)[2]
    assert slow.limit[0] < 0 < slow.limit[1]
    np.testing.assert_array_equal(fast.limit, 0.0)
