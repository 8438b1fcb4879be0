"""The battery: every factor does what it says, with the right bits and scores."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_tasks import SIZE, START, one_shoe, packing, start

from gril_jax.audit.states import FACTORS, battery, orders, successes


@functools.cache
def _made(name):
    task = {"one_shoe": one_shoe, "packing": packing}[name]()
    made = jax.jit(lambda key: battery(key, task, start()))(jax.random.key(0))
    return task, jax.tree.map(np.asarray, made)


def _of(made, factor):
    return made.factor == FACTORS.index(factor)


@pytest.fixture(scope="module")
def shoe():
    return _made("one_shoe")


def test_the_first_state_is_the_start_without_bits(shoe):
    _, made = shoe
    np.testing.assert_array_equal(made.scenes.center[0], START)
    assert not made.scenes.active[0].any()
    assert made.score[0] == 0
    assert _of(made, "start").sum() == 1


def test_scores_are_the_tasks_and_what_moved_has_its_bit(shoe):
    task, made = shoe
    wanted = jax.vmap(lambda c: task.progress(c, SIZE))(made.scenes.center)
    np.testing.assert_allclose(made.score, wanted)
    moved = (np.abs(made.scenes.center - np.asarray(START)) > 1e-3).any(axis=2)
    assert (made.scenes.active | ~moved).all()
    assert made.scenes.active[moved.any(axis=1), 0].all()
    bits_alone = made.scenes.active & ~moved
    bits_alone[:, 0] = False
    kinds = np.unique(made.factor[bits_alone.any(axis=1)])
    assert {FACTORS[k] for k in kinds} == {"touched", "undone"}


def test_successes_are_anywhere_and_what_else_there_is_moves_or_rests():
    task = one_shoe()
    made = jax.jit(lambda key: successes(key, task, start()))(jax.random.key(3))
    progress = jax.vmap(lambda c: task.progress(c, SIZE))(made.center)
    assert (progress >= 0.999).mean() > 0.9  # but for a stone that was pushed into the box
    moved = np.asarray((made.center != START).any(axis=2))
    assert moved[:, 2].all()
    assert (np.abs(moved[:, [0, 1, 3, 4]].mean(axis=0) - 0.5) < 0.1).all()
    np.testing.assert_array_equal(made.active[:, 1:], moved[:, 1:])


def test_each_factor_changes_what_it_says(shoe):
    task, made = shoe
    center, moved = made.scenes.center, (made.scenes.center != np.asarray(START)).any(axis=2)
    assert (made.score[_of(made, "success")] == 1).all()
    for kind, indices in (("wrong place", [2]), ("detour", [2]), ("robot", [0])):
        assert (moved[_of(made, kind)].any(axis=0) == np.isin(np.arange(5), indices)).all()
        assert (made.score[_of(made, kind)] == 0).all() or kind == "detour"
    assert not moved[_of(made, "touched")].any()
    assert made.scenes.active[_of(made, "touched")].all()
    assert sorted(made.score[_of(made, "wrong object")]) == [0, 0.5]
    assert not moved[_of(made, "undone")][:, 2].any()
    assert made.scenes.active[_of(made, "undone")][:, 2].all()
    assert moved[_of(made, "scattered")][:, [1, 3, 4]].all()
    assert set(np.round(made.score[_of(made, "random")], 2)) >= {0.0, 1.0}
    limit = np.asarray(task.limit(SIZE))
    assert (np.abs(center) <= limit + 1e-6).all()


def test_every_state_is_compared_with_the_chains_and_random_ones_with_each_other(shoe):
    _, made = shoe
    random = _of(made, "random")
    assert (random[made.first] == random[made.second]).all()
    assert (made.first != made.second).all()
    np.testing.assert_array_equal(
        made.pair_factor, np.where(random[made.first], FACTORS.index("random"),
                                   made.factor[made.first])
    )  # fmt: skip
    compared = np.zeros(len(made.factor), bool)
    compared[made.first] = compared[made.second] = True
    assert compared.all()


def test_stages_are_done_in_every_order_that_they_allow():
    assert orders(one_shoe()) == [(0,)]
    assert orders(packing()) == [(0, 1, 2)]
    free = packing()
    loose = [s.__class__(s.name, s.moves, s.holds, s.place) for s in free.stages]
    assert orders(free.__class__(tuple(loose), free.movable, 1.0, free.score)) == [
        (0, 1, 2),
        (2, 1, 0),
    ]


@pytest.mark.slow
def test_stages_in_a_fixed_order_make_a_chain_of_rising_progress():
    _, made = _made("packing")
    chain = made.score[: 1 + _of(made, "progress").sum()]
    np.testing.assert_allclose(chain, [0, 1 / 3, 2 / 3, 1], atol=1e-6)
    assert (made.score[_of(made, "success")] == 1).all()


@pytest.mark.slow
def test_vmap_equals_a_loop():
    task = one_shoe()
    keys = jax.random.split(jax.random.key(3), 2)
    many = jax.jit(jax.vmap(lambda key: battery(key, task, start())))(keys)
    for i in range(2):
        one = jax.jit(lambda key: battery(key, task, start()))(keys[i])
        jax.tree.map(
            lambda a, b, i=i: np.testing.assert_allclose(jnp.asarray(a)[i], b, atol=1e-6), many, one
        )
