"""Meaning of the actions of MatchRegions."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical import physics, simulator
from gril_jax.envs.magical.physics import Gripping, Pupils
from gril_jax.envs.planar.impulses import Bodies, Motion
from gril_jax.envs.planar.joints import Aims
from gril_jax.envs.planar.plane import Vec
from support import planar_scenes

from gril_jax import envs

OPEN = math.pi / 8


def test_a_turn_is_bang_bang_beyond_a_sixteenth():
    """An offset of a turns at a / (2 dt), at most at 2.5 rad/s."""
    env = envs.make("match_regions")
    for turn in (-1.0, 0.02, 0.0625, 0.3):
        rate = env._command(jnp.array([0.0, turn, 0.0])).turn / (2 * env._engine.dt)
        assert float(rate) == pytest.approx(40 * turn, rel=1e-6)
        assert (abs(rate) >= 2.5 - 1e-6) == (abs(turn) >= 0.0625)


@pytest.mark.parametrize(
    ("action", "speed", "turn", "opening"),
    [
        ([1.0, 0.0, 0.0], 0.8, 0, OPEN),
        ([0.3, 0.0, 0.0], 0.0, 0, OPEN),
        ([-0.6, 0.0, -1.0], -0.6, 0, OPEN),
        ([0.0, 0.6, 0.1], 0.0, 1.5, 0.0),
        ([0.0, -0.9, 1.0], 0.0, -1.5, 0.0),
        ([0.0, 0.4, 0.0], 0.0, 0, OPEN),
    ],
)
def test_magical_rounds_actions_to_its_eighteen(action, speed, turn, opening):
    magical = envs.make("match_regions", physics="magical")
    command = magical._command(jnp.array(action))
    np.testing.assert_allclose(list(map(float, command)), [speed, turn, opening], rtol=1e-6)


def test_magicals_numbers_are_its_eighteen_commands():
    """9 * grip + 3 * turn + drive, decoded by a plain loop."""
    found = simulator.from_magical(np.arange(18))
    for number, action in enumerate(found):
        grip, turn, drive = number // 9, number // 3 % 3, number % 3
        command = simulator.rounded_command(jnp.asarray(action))
        expected = [(0.0, 0.8, -0.6)[drive], (0.0, 1.5, -1.5)[turn], (OPEN, 0.0)[grip]]
        np.testing.assert_allclose(list(map(float, command)), expected, rtol=1e-6)
    assert simulator.from_magical(np.zeros((2, 0), int)).shape == (2, 0, 3)


@pytest.mark.parametrize("wrong", [-1, 18])
def test_other_numbers_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must lie in 0 to 17"):
        simulator.from_magical(np.array([0, wrong]))


# --- MAGICAL's own parts of the physics, against loops in numpy and the original engine's figures

DT = 0.0125
MASS, INERTIA = np.array([1.0, 0.125, 0.125]), np.array([0.02, 0.005, 0.005])
BODIES = Bodies(jnp.float32(1 / MASS), jnp.float32(1 / INERTIA))
TURNED = (0.1950, 0.5075, 0.8200, 0.9338, 0.9338, 0.9338)  # rad, of the original engine


def _motion(rng):
    push, spin = rng.normal(size=(3, 2)), rng.normal(size=3)
    zero = jnp.zeros(3)
    motion = Motion(Vec(*jnp.float32(push.T)), jnp.float32(spin), Vec(zero, zero), zero)
    return push, spin, motion


def _aim(rng, limit=(0.0, 0.0)):
    arm, off, rate = rng.normal(size=(2, 2)) * 0.1, rng.normal(size=(2, 2)), rng.normal(size=2)
    limit = np.array(limit)
    vec = lambda v: Vec(*jnp.float32(v.T))  # noqa: E731
    zero, limits = jnp.zeros(()), jnp.asarray(limit, jnp.float32)
    aim = Aims(Vec(zero, zero), zero, jnp.float32(rate), vec(arm), vec(off), limits)
    return arm, off, rate, limit, aim


@pytest.mark.parametrize("limit", [(0.0, 0.0), (3.0, -2.0)])
@pytest.mark.parametrize("f", [0, 1])
def test_a_finger_gets_pin_then_stop_then_motor(f, limit):
    """Against the same joints written out in float64."""
    rng = np.random.default_rng(f)
    push, spin, motion = _motion(rng)
    arm, off, rate, limit, aim = _aim(rng, limit)
    strength, w = 0.01, 1 + f
    n = -off[f] / np.linalg.norm(off[f])
    leverage = arm[f, 0] * n[1] - arm[f, 1] * n[0]

    anchor = push[0] + spin[0] * np.array([-arm[f, 1], arm[f, 0]])
    light = 1 / MASS[0] + 1 / MASS[w] + leverage**2 / INERTIA[0]
    pin = (-np.linalg.norm(off[f]) - (push[w] - anchor) @ n) / light
    push[0] -= n * pin / MASS[0]
    push[w] += n * pin / MASS[w]
    spin[0] -= leverage * pin / INERTIA[0]
    heavy = 1 / (1 / INERTIA[0] + 1 / INERTIA[w])
    stop = (limit[f] - (spin[w] - spin[0])) * heavy
    stop = max(stop, 0.0) if limit[f] > 0 else min(stop, 0.0) if limit[f] < 0 else 0.0
    spin += stop * np.array([-1 / INERTIA[0], (f == 0) / INERTIA[1], (f == 1) / INERTIA[2]])
    motor = np.clip((rate[f] - (spin[w] - spin[0])) * heavy, -strength, strength)
    spin += motor * np.array([-1 / INERTIA[0], (f == 0) / INERTIA[1], (f == 1) / INERTIA[2]])

    zero = jnp.zeros(2)
    given = Gripping(zero, zero, zero, Pupils(zero, zero, zero))
    direction = physics._directions(aim, DT)[f]
    found, sums = physics._finger(motion, f, direction, given, aim, BODIES, strength)
    found_push = np.stack([found.push.x, found.push.y], axis=1)
    np.testing.assert_allclose(found_push, push, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(found.spin, spin, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(sums, [pin, stop, motor], rtol=1e-4, atol=1e-6)


def test_a_finger_on_its_place_is_held_along_a_fixed_direction_and_its_gradient_is_finite():
    def length(off):
        zero = jnp.zeros(())
        aim = Aims(Vec(zero, zero), zero, pivot=Vec(off, off))
        n = physics._directions(aim, DT)
        return (n.x + n.y).sum()

    value, slope = jax.value_and_grad(length)(jnp.zeros(2))
    assert value == pytest.approx(physics.HELD.sum())
    np.testing.assert_allclose(np.linalg.norm(physics.HELD, axis=1), 1.0)
    assert np.isfinite(slope).all()


def test_pupils_keep_the_angular_momentum_and_come_to_turn_with_the_base():
    rng = np.random.default_rng(0)
    *_, motion = _motion(rng)
    pupils = Pupils(jnp.zeros(2), jnp.float32(rng.normal(size=2)), jnp.zeros(2))
    momentum = lambda m, p: 0.02 * m.spin[0] + 0.002 * p.spin.sum()  # noqa: E731
    before, apart = momentum(motion, pupils), np.abs(motion.spin[0] - pupils.spin)
    for _ in range(300):  # substeps
        pupils = pupils._replace(wanted=jnp.zeros(2))
        motion, pupils = physics._damped(motion, pupils, BODIES, DT)
    np.testing.assert_allclose(momentum(motion, pupils), before, rtol=1e-4)
    assert (np.abs(motion.spin[0] - pupils.spin) < 0.02 * apart).all()


@functools.cache
def _play(actions):
    """Poses (T + 1, E, 3) from the Demo start under a tuple of actions, 10 sweeps."""
    env = envs.make(
        "match_regions", physics="magical", iterations=10, targets=("green star",), distractors=()
    )
    start = env.reset(jax.random.key(0))
    move = lambda state, action: (lambda s: (s, s.data.pose))(env.step(state, action))  # noqa: E731
    poses = jax.jit(lambda a: jax.lax.scan(move, start, a)[1])(jnp.array(actions, jnp.float32))
    return np.concatenate([np.asarray(start.data.pose)[None], np.asarray(poses)])


def test_robot_turns_and_stops_like_the_originals():
    """Angle after each control step of the original engine with MAGICAL's scene."""
    pose = _play(((0.0, 1.0, -1.0),) * 3 + ((0.0, 0.0, -1.0),) * 3)
    turned = pose[1:, 0, 2] - pose[0, 0, 2]
    np.testing.assert_allclose(turned, TURNED, atol=4e-3)
    assert np.abs(pose[:, 0, :2] - pose[0, 0, :2]).max() < 1e-3  # on the spot


def test_fingers_stay_near_their_pivots():
    pose = _play(((0.0, 1.0, -1.0),) * 3 + ((0.0, 0.0, -1.0),) * 3)
    for moment in pose:
        pivots = planar_scenes.parts("gripper", moment[0])[1:, :2]
        assert np.linalg.norm(moment[1:3, :2] - pivots, axis=1).max() < 5e-3
