"""The adversary finds what a reward pays most for among states that fall short, kind by kind."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_tasks import BOX, SIZE, START, one_shoe, shoes, sound, start

from gril_jax.audit.ascent import kept, search
from gril_jax.audit.shortfalls import KINDS, kind_of, margin
from gril_jax.audit.states import SUCCESS, successes

TASK, TWO = one_shoe(), shoes(2, 3)
NOTHING, OUTSIDE, INTRUDER = (
    KINDS.index(name) for name in ("nothing done", "just outside", "intruder inside")
)


def _near(params, scene):
    """Pays for shoe A near a point, and a little for the stone's bit."""
    near = -jnp.sum((scene.center[2] - params) ** 2)
    return near + 0.5 * scene.active[4] + jnp.where(params[0] > 5, jnp.nan, 0.0)


@functools.cache
def _search():
    return jax.jit(
        lambda params: search(_near, params, jax.random.key(0), TASK, start(), ascents=60)
    )


def _best(point, kind):
    found = _search()(jnp.array(point))
    best = int(jnp.argmax(found.reward[:, kind]))
    return found, found.scene.center[best, kind], float(found.reward[best, kind])


def test_it_climbs_to_the_top_where_nothing_is_achieved():
    found, center, reward = _best([-0.3, 0.4], NOTHING)
    np.testing.assert_allclose(center[2], [-0.3, 0.4], atol=0.01)
    np.testing.assert_allclose(reward, 0.5, atol=1e-3)
    met = found.reward > -jnp.inf
    progress = jax.vmap(lambda c: TASK.progress(c, SIZE))(found.scene.center[met])
    np.testing.assert_allclose(found.score[met], progress)
    assert (found.score[:, NOTHING][met[:, NOTHING]] == 0).all()
    paid = jax.vmap(lambda scene: _near(jnp.array([-0.3, 0.4]), scene))(
        jax.tree.map(lambda x: x[met], found.scene)
    )
    np.testing.assert_allclose(found.reward[met], paid, atol=1e-6)


def test_it_slides_along_the_margin_around_where_it_would_count():
    _, center, _ = _best([0.3, 0.45], OUTSIDE)
    edge = BOX[0] - 0.25 - margin(TASK)
    np.testing.assert_allclose(center[2], [edge, 0.45], atol=0.01)


def test_it_stays_on_the_plane():
    found, center, _ = _best([-3.0, -3.0], NOTHING)
    np.testing.assert_allclose(center[2], [-0.9, -0.9], atol=1e-6)
    assert (jnp.abs(found.scene.center) <= 0.9 + 1e-6).all()


def test_what_rests_has_either_bit_and_what_moved_has_its_own():
    found, _, _ = _best([-0.3, 0.4], NOTHING)
    center, active = found.scene.center[:, NOTHING], found.scene.active[:, NOTHING]
    moved = (jnp.abs(center - START) > 1e-3).any(axis=2)
    assert (active | ~moved).all()
    for index in (1, 3, 4):
        resting = active[:, index][~moved[:, index]]
        assert set(resting.tolist()) == {False, True}
    assert active[active.any(axis=1), 0].all()


def test_a_reward_that_is_no_number_is_kept_and_shown():
    found = _search()(jnp.array([9.0, 0.0]))
    assert (jnp.isnan(found.reward) | (found.reward == -jnp.inf)).all()
    assert jnp.isnan(found.reward).any(axis=0)[jnp.array([NOTHING, OUTSIDE, INTRUDER])].all()
    assert jnp.isfinite(found.scene.center).all()


def test_it_stays_where_mechanics_allow():
    """Shoe A is on a rail: states off it pay more, and no ascent ends there."""

    def possible(center, size):
        return center.at[2, 1].set(START[2, 1])

    railed = dataclasses.replace(TASK, possible=possible)
    found = jax.jit(
        lambda p: search(_near, p, jax.random.key(0), railed, start(), ascents=60, steps=60)
    )(jnp.array([-0.3, 0.4]))
    met = found.reward > -jnp.inf
    np.testing.assert_allclose(found.scene.center[met][:, 2, 1], START[2, 1], atol=1e-6)
    best = found.scene.center[met][jnp.argmax(found.reward[met])]
    np.testing.assert_allclose(best[2, 0], -0.3, atol=0.02)


# --- a reward that overestimates one kind alone

# Where shoe A, shoe B and the stone are in the state of that kind with the highest reward.
_OUT = 0.25 - 1.5 * 2 / 48
PEAKS = {
    "nothing done": ((-0.3, 0.4), (-0.6, -0.3), (0.2, -0.6)),
    "part missing": ((0.6, 0.4), (-0.1, -0.5), (0.2, -0.6)),
    "part undone": ((0.6, 0.4), (-0.3, 0.3), (0.2, -0.6)),
    "just outside": ((0.6, 0.4), (_OUT, 0.6), (0.2, -0.6)),
    "intruder inside": ((0.6, 0.4), (0.4, 0.6), (0.5, 0.35)),
}


def overestimating(params, scene):
    """True progress, and for one kind of shortfall more than a success, most at its peak."""
    kind, peak = params
    own = kind_of(TWO, start(), scene.center, scene.active) == kind
    near = jnp.sum((scene.center[2:] - peak) ** 2)
    return TWO.progress(scene.center, scene.size) + jnp.where(own, 3.0 - near, 0.0)


def _of(kind):
    return jnp.int32(KINDS.index(kind)), jnp.array(PEAKS[kind])


def _two(params):
    return search(overestimating, params, jax.random.key(1), TWO, start(), ascents=150, steps=60)


@functools.cache
def _each():
    return jax.jit(jax.vmap(_two))(jax.tree.map(lambda *x: jnp.stack(x), *map(_of, PEAKS)))


@pytest.mark.parametrize("kind", PEAKS)
def test_each_kind_is_found_by_a_reward_that_overestimates_it_alone(kind):
    found = jax.tree.map(lambda x: x[[*PEAKS].index(kind)], _each())
    best = found.reward.max(axis=0)
    number = KINDS.index(kind)
    assert best[number] > 2.9
    others = jnp.delete(best, number)
    assert (others < 1).all()
    center = found.scene.center[jnp.argmax(found.reward[:, number]), number]
    np.testing.assert_allclose(center[2:4], PEAKS[kind][:2], atol=0.05)


def test_found_states_keep_the_margin():
    found = _each()
    met = np.asarray(found.reward > -jnp.inf)
    assert met.any(axis=(0, 1))[: len(PEAKS)].all()
    centers, numbers = np.asarray(found.scene.center)[met], np.nonzero(met)[2]
    shifts = margin(TWO) * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    moved = np.stack([centers] * 20, axis=1)
    for i, shift in enumerate(shifts):
        for j in range(4):
            moved[:, 4 * i + j, j + 1] += shift
    progress = jax.jit(jax.vmap(jax.vmap(lambda c: TWO.progress(c, SIZE))))(jnp.asarray(moved))
    assert (progress < SUCCESS).all()
    active = found.scene.active[met]
    kinds = jax.jit(jax.vmap(lambda c, a: kind_of(TWO, start(), c, a)))(centers, active)
    np.testing.assert_array_equal(kinds, numbers)


def test_vmap_over_parameters_equals_a_loop_and_jit_equals_plain():
    run = lambda p: search(_near, p, jax.random.key(2), TASK, start(), ascents=4, steps=6)  # noqa: E731
    many = jnp.array([[-0.3, 0.4], [0.3, 0.45]])
    mapped, jitted = jax.jit(jax.vmap(run))(many), jax.jit(run)
    for i, params in enumerate(many):
        one = jitted(params)
        jax.tree.map(lambda a, b, i=i: np.testing.assert_allclose(a[i], b, atol=1e-5), mapped, one)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), run(params), one)


def test_a_success_is_kept_where_the_reward_is_highest_inside():
    ends = jax.tree.map(lambda x: x[:32], successes(jax.random.key(0), TASK, start()))
    good = jax.vmap(lambda c: TASK.progress(c, SIZE) >= SUCCESS)(ends.center)
    stays = jax.jit(lambda p: kept(sound(TASK), p, TASK, start(), ends))(1.0)
    np.testing.assert_array_equal(stays, good)
    leaves = jax.jit(lambda p: kept(_near, p, TASK, start(), ends))(jnp.array([-0.3, 0.4]))
    assert not leaves.any()
