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


# ---------------------------------------------------------------- the table

BLOCKS = Bodies(jnp.full(4, 100.0), jnp.full(4, 1e4))


def _hold(velocity, spin, force, torque):
    none = Servo(Vec(jnp.zeros(4), jnp.zeros(4)), jnp.zeros(4))
    return joints.hold(velocity, spin, none, BLOCKS, force, torque)


def test_a_strong_table_stops_a_block():
    velocity, spin = _vec([[0.8, 0], [0, -0.8], [0.5, 0.5], [0, 0]]), jnp.array([5.0, -3, 0, 1])
    j = _hold(velocity, spin, 1.0, 1.0)
    for v, p in ((velocity.x, j.push.x), (velocity.y, j.push.y)):
        np.testing.assert_allclose(v + 100 * p, 0.0, atol=1e-6)
    np.testing.assert_allclose(spin + 1e4 * j.turn, 0.0, atol=1e-5)


def test_the_tables_force_is_the_same_in_every_direction_and_against_the_motion():
    velocity = 50.0 * np.array([[1, 0], [0, 1], [0.6, 0.8], [-0.8, -0.6]])
    j = _hold(_vec(velocity), jnp.zeros(4), 1.5 * DT, 0.1 * DT)
    push = np.stack([j.push.x, j.push.y], axis=1)
    np.testing.assert_allclose(push, -1.5 * DT * velocity / 50, rtol=1e-5, atol=1e-8)


def test_the_tables_torque_has_its_own_limit():
    j = _hold(_vec(np.zeros((4, 2))), jnp.array([1e4, -1e4, 1.0, 0.0]), 1.5 * DT, 0.1 * DT)
    np.testing.assert_allclose(j.turn, [-0.1 * DT, 0.1 * DT, -1e-4, 0.0], rtol=1e-5)
    np.testing.assert_array_equal(j.push.x, 0.0)


def test_impulses_add_up_to_no_more_than_the_limit_over_many_sweeps():
    velocity, given = _vec(np.full((4, 2), 30.0)), Servo(_vec(np.zeros((4, 2))), jnp.zeros(4))
    for _ in range(20):
        given = joints.hold(velocity, jnp.full(4, 1e4), given, BLOCKS, 0.02, 0.001)
        size = np.hypot(given.push.x, given.push.y)
        assert (size <= 0.02 * (1 + 1e-5)).all()
        assert (np.abs(given.turn) <= 0.001 * (1 + 1e-5)).all()


# ---------------------------------------------------------------- the drive


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


BASE = Bodies(jnp.float32(1.0), jnp.float32(50.0))


def _driven(speed, turn, force, torque):
    """Impulses on a base at rest that faces 0.7."""
    aim = _aims(planar_scenes.parts("short", (0, 0, 0.7)), speed=speed, turn=turn)
    zero = jnp.zeros(())
    none = Servo(Vec(zero, zero), zero)
    return aim, joints.drive(Vec(zero, zero), zero, none, aim, BASE, force, torque)


def test_a_strong_drive_reaches_its_aims_at_once():
    aim, j = _driven(0.8, 0.01, 10.0, 10.0)
    assert float(j.push.x) == pytest.approx(float(aim.drive.x), rel=1e-5)
    assert float(j.push.y) == pytest.approx(float(aim.drive.y), rel=1e-5)
    assert float(j.turn * 50) == pytest.approx(float(aim.turn), rel=1e-5)


def test_the_drives_force_and_torque_are_capped():
    aim, j = _driven(0.8, 1.0, 5 * DT, 1 * DT)
    assert math.hypot(float(j.push.x), float(j.push.y)) == pytest.approx(5 * DT, rel=1e-5)
    assert float(j.push.cross(aim.drive)) == pytest.approx(0.0, abs=1e-6)
    assert _driven(0.0, 1.0, 5 * DT, 0.01 * DT)[1].turn == pytest.approx(0.01 * DT, rel=1e-5)


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
