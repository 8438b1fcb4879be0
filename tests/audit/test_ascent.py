"""The adversary finds what a reward pays most for among states without progress."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from support.audit_tasks import BOX, SIZE, START, one_shoe, start

from gril_jax.audit.ascent import search

TASK = one_shoe()


def _near(params, scene):
    """Pays for shoe A near a point, and a little for the stone's bit."""
    near = -jnp.sum((scene.center[2] - params) ** 2)
    return near + 0.5 * scene.active[4] + jnp.where(params[0] > 5, jnp.nan, 0.0)


@functools.cache
def _search():
    return jax.jit(
        lambda params: search(_near, params, jax.random.key(0), TASK, start(), ascents=60)
    )


def _best(point):
    found = _search()(jnp.array(point))
    best = int(jnp.argmax(found.reward))
    return found, found.scene.center[best], float(found.reward[best])


def test_it_climbs_to_the_top_where_nothing_is_achieved():
    found, center, reward = _best([-0.3, 0.4])
    np.testing.assert_allclose(center[2], [-0.3, 0.4], atol=0.01)
    np.testing.assert_allclose(reward, 0.5, atol=1e-3)
    progress = jax.vmap(lambda c: TASK.progress(c, SIZE))(found.scene.center)
    assert (progress == 0).all()
    paid = jax.vmap(lambda scene: _near(jnp.array([-0.3, 0.4]), scene))(found.scene)
    np.testing.assert_allclose(found.reward, paid, atol=1e-6)


def test_it_slides_along_the_edge_of_where_it_would_count():
    _, center, _ = _best([0.45, 0.6])
    assert TASK.progress(center, SIZE) == 0
    np.testing.assert_allclose(center[2], [BOX[0] - 0.25, 0.6], atol=0.01)


def test_it_stays_on_the_plane():
    found, center, _ = _best([-3.0, -3.0])
    np.testing.assert_allclose(center[2], [-0.9, -0.9], atol=1e-6)
    assert (jnp.abs(found.scene.center) <= 0.9 + 1e-6).all()


def test_what_rests_has_either_bit_and_what_moved_has_its_own():
    found, _, _ = _best([-0.3, 0.4])
    moved = (jnp.abs(found.scene.center - START) > 1e-3).any(axis=2)
    active = found.scene.active
    assert (active | ~moved).all()
    for index in (1, 2, 3, 4):
        resting = active[:, index][~moved[:, index]]
        assert set(resting.tolist()) == {False, True}
    assert active[active.any(axis=1), 0].all()


def test_a_reward_that_is_no_number_is_kept_and_shown():
    found = _search()(jnp.array([9.0, 0.0]))
    assert jnp.isnan(found.reward).all()
    assert jnp.isfinite(found.scene.center).all()


def test_it_stays_where_mechanics_allow():
    """Shoe A is on a rail: states off it pay more, and no ascent ends there."""

    def possible(center, size):
        return center.at[2, 1].set(START[2, 1])

    railed = dataclasses.replace(TASK, possible=possible)
    found = jax.jit(
        lambda p: search(_near, p, jax.random.key(0), railed, start(), ascents=20, steps=40)
    )(jnp.array([-0.3, 0.4]))
    np.testing.assert_allclose(found.scene.center[:, 2, 1], START[2, 1], atol=1e-6)
    best = found.scene.center[jnp.argmax(found.reward)]
    np.testing.assert_allclose(best[2, 0], -0.3, atol=0.02)
