"""Impulses at contacts: they conserve momentum, stop an approach, never pull, keep the cone."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.planar import impulses
from gril_jax.envs.planar.contacts import Contacts
from gril_jax.envs.planar.impulses import Bodies, Impulse, Motion
from gril_jax.envs.planar.plane import Vec, heading

DT, N = 0.0125, 8


def _vec(rng, scale=1.0):
    return Vec(*jnp.asarray(scale * rng.normal(size=(2, N)), jnp.float32))


def _motion(rng):
    spin, twist = jnp.asarray(rng.normal(size=(2, N)), jnp.float32)
    return Motion(_vec(rng), spin, _vec(rng), twist)


def _bodies(rng):
    return Bodies(*jnp.asarray(rng.uniform(0.5, 3, (2, N)), jnp.float32))


def _none():
    return Impulse(*[jnp.zeros(N)] * 3)


def _pair(seed=0, gap=0.0, friction=0.5):
    """Rows of N contacts between random bodies, those bodies and their offset."""
    rng = np.random.default_rng(seed)
    normal = heading(jnp.asarray(rng.uniform(-3, 3, N), jnp.float32))
    contacts = Contacts(jnp.full(N, gap), normal, _vec(rng, 0.1))
    first, second, offset = _bodies(rng), _bodies(rng), _vec(rng, 0.3)
    rows = impulses.prepare(contacts, friction, first, offset, second, dt=DT)
    return rows, contacts, offset, _motion(rng), _motion(rng)


def _plus(a, b):
    return jax.tree.map(jnp.add, a, b)


def _along(contacts, offset, first, second, gap=0.0):
    """Relative velocity at the contact: along the normal, and across it."""
    arm = offset + contacts.second - contacts.normal * gap
    speed = second.push + contacts.second.turned() * second.spin
    speed = speed - first.push - arm.turned() * first.spin
    return speed.dot(contacts.normal), contacts.normal.cross(speed)


@pytest.mark.parametrize(("gap", "tangent"), [(0.0, 1.0), (-0.03, 0.0), (0.02, 0.0)])
def test_a_kick_conserves_linear_and_angular_momentum(gap, tangent):
    rows, _, offset, *_ = _pair(gap=gap)
    rng = np.random.default_rng(1)
    j = Impulse(*jnp.asarray(rng.normal(size=(3, N)), jnp.float32))
    first, second = impulses.kick(rows, j._replace(tangent=tangent * j.tangent))
    for push, spin in (("push", "spin"), ("shift", "twist")):
        p, q = (
            getattr(m, push) * (1 / b.inverse_mass)
            for m, b in ((first, rows.first), (second, rows.second))
        )
        np.testing.assert_allclose((p + q).x, 0.0, atol=1e-5)
        np.testing.assert_allclose((p + q).y, 0.0, atol=1e-5)
        turning = getattr(first, spin) / rows.first.inverse_inertia
        turning += getattr(second, spin) / rows.second.inverse_inertia + offset.cross(q)
        np.testing.assert_allclose(turning, 0.0, atol=1e-5)


def test_a_kick_at_a_wall_moves_the_second_body_alone():
    rows, contacts, *_ = _pair()
    rows = impulses.prepare(contacts, 0.4, None, None, rows.second, dt=DT)
    first, second = impulses.kick(rows, Impulse(*[jnp.ones(N)] * 3))
    assert first is None
    push = contacts.normal + contacts.normal.turned()
    np.testing.assert_allclose(second.push.x, push.x * rows.second.inverse_mass, rtol=1e-5)
    torque = contacts.second.cross(push) * rows.second.inverse_inertia
    np.testing.assert_allclose(second.spin, torque, atol=1e-5)


def test_one_pass_stops_the_approach_at_a_frictionless_contact_and_nothing_else():
    rows, contacts, offset, first, second = _pair(friction=0.0)
    before, _ = _along(contacts, offset, first, second)
    j = impulses.solve(rows, _none(), first, second)
    a, b = impulses.kick(rows, j)
    after, _ = _along(contacts, offset, _plus(first, a), _plus(second, b))
    approaches = np.asarray(before) < 0
    assert 0 < approaches.sum() < N
    np.testing.assert_allclose(np.asarray(after)[approaches], 0.0, atol=1e-5)
    np.testing.assert_allclose(after[~approaches], before[~approaches], atol=1e-6)
    np.testing.assert_array_equal(np.asarray(j.normal) > 0, approaches)


def test_contacts_never_pull():
    for seed in range(20):
        rows, _, _, first, second = _pair(seed)
        rng = np.random.default_rng(100 + seed)
        given = Impulse(*jnp.abs(jnp.asarray(rng.normal(size=(3, N)), jnp.float32)))
        j = impulses.solve(rows, given, first, second)
        assert (j.normal >= 0).all()
        assert (j.shift >= 0).all()


def test_friction_stays_within_its_cone_and_against_the_slip():
    for seed in range(20):
        rows, contacts, offset, first, second = _pair(seed, friction=0.3)
        _, slip = _along(contacts, offset, first, second)
        j = impulses.solve(rows, _none(), first, second)
        assert (jnp.abs(j.tangent) <= 0.3 * j.normal + 1e-6).all()
        assert (j.tangent * slip <= 1e-6).all()


def test_enough_friction_stops_the_slip_in_some_passes():
    rows, contacts, offset, first, second = _pair(friction=1e3)
    j = _none()
    a, b = first, second
    for _ in range(60):
        new = impulses.solve(rows, j, a, b)
        back, on = impulses.kick(rows, Impulse(*(x - y for x, y in zip(new, j, strict=True))))
        a, b, j = _plus(a, back), _plus(b, on), new
    normal, slip = _along(contacts, offset, a, b)
    pressed = np.asarray(j.normal) > 1e-3
    assert pressed.any()
    np.testing.assert_allclose(np.asarray(normal)[pressed], 0.0, atol=1e-3)
    np.testing.assert_allclose(np.asarray(slip)[pressed], 0.0, atol=1e-3)
    assert (np.asarray(normal) > -1e-3).all()


@pytest.mark.parametrize("gap", [1e-6, 0.004, 0.5])
def test_bodies_that_do_not_touch_do_not_feel_each_other(gap):
    rows, _, _, first, second = _pair(gap=gap)
    first, second = (m._replace(push=m.push * 5) for m in (first, second))
    for field in impulses.solve(rows, _none(), first, second):
        np.testing.assert_array_equal(field, 0.0)


@pytest.mark.parametrize("gap", [0.02, 0.0, -0.01, -0.03])
def test_overlaps_beyond_a_hundredth_are_undone_at_chipmunks_rate(gap):
    """A share of 1 - 0.9^60 of it a second, by the second system, which sets nothing in motion."""
    rows, *_ = _pair(gap=gap)
    still = Motion(*[Vec(jnp.zeros(N), jnp.zeros(N)), jnp.zeros(N)] * 2)
    j = impulses.solve(rows, _none(), still, still)
    first, second = impulses.kick(rows, j)
    rate = (1 - (0.9**60) ** DT) / DT * max(-gap - 0.01, 0.0)
    expected = np.full(N, rate)
    leave = rows.normal.dot(second.shift) + second.twist * rows.leverage.x
    leave -= rows.normal.dot(first.shift) + first.twist * rows.recoil.x
    np.testing.assert_allclose(leave, expected, atol=1e-6)
    if gap <= 0:
        np.testing.assert_allclose(second.push.x, 0.0, atol=1e-6)
        np.testing.assert_allclose(first.spin, 0.0, atol=1e-6)


def test_jit_is_plain_and_vmap_is_a_loop():
    def solved(rows, first, second):
        return impulses.solve(rows, _none(), first, second)

    many = [_pair(seed) for seed in range(3)]
    many = [(rows._replace(friction=jnp.float32(0.5)), a, b) for rows, _, _, a, b in many]
    loop = [solved(*one) for one in many]
    stacked = jax.tree.map(lambda *f: jnp.stack(f), *many)
    lanes = jax.jit(jax.vmap(solved))(*stacked)
    for field, *each in zip(lanes, *loop, strict=True):
        np.testing.assert_allclose(field, np.stack(each), atol=1e-5)
