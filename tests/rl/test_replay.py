"""The ring of transitions beside a list, and what it must not do: copy itself."""

import collections

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.errors import ShapeError
from gril_jax.rl import replay

ROW = {"a": jax.ShapeDtypeStruct((), jnp.int32), "b": jax.ShapeDtypeStruct((2,), jnp.float32)}


def _rows(first, count):
    a = first + jnp.arange(count, dtype=jnp.int32)
    return {"a": a, "b": jnp.stack([a, -a], axis=1).astype(jnp.float32)}


def test_it_holds_the_newest_rows_as_a_bounded_list_does():
    ring, expected = replay.init(ROW, 6), collections.deque(maxlen=6)
    for first in range(0, 14, 2):
        ring = replay.insert(ring, _rows(first, 2))
        expected.extend(range(first, first + 2))
        assert int(ring.size) == len(expected)
        stored = np.asarray(ring.rows["a"])[: len(expected)]
        assert sorted(stored.tolist()) == sorted(expected)
        np.testing.assert_array_equal(ring.rows["b"][:, 1], -ring.rows["a"])


def test_rows_that_are_not_wanted_change_no_bit():
    ring = replay.insert(replay.init(ROW, 6), _rows(5, 2))
    same = replay.insert(ring, _rows(50, 2), wanted=False)
    jax.tree.map(np.testing.assert_array_equal, same, ring)


def test_samples_are_spread_evenly_over_what_is_stored():
    ring = replay.insert(replay.init(ROW, 8), _rows(1, 4))
    drawn = replay.sample(ring, jax.random.key(0), 4000)
    values, counts = np.unique(drawn["a"], return_counts=True)
    assert values.tolist() == [1, 2, 3, 4]
    assert counts.min() > 900
    np.testing.assert_array_equal(drawn["b"][:, 0], drawn["a"])


def test_an_empty_ring_gives_zeros():
    drawn = replay.sample(replay.init(ROW, 4), jax.random.key(0), 3)
    assert not any(np.asarray(x).any() for x in jax.tree.leaves(drawn))


def test_rows_that_do_not_divide_the_capacity_are_refused():
    with pytest.raises(ShapeError, match="4 rows are inserted into a replay of 6"):
        replay.insert(replay.init(ROW, 6), _rows(0, 4))


def test_rings_side_by_side_equal_rings_one_by_one():
    """Also where they stand at different places, and where one of them wants no row."""
    rings = [replay.init(ROW, 6), replay.insert(replay.init(ROW, 6), _rows(1, 2))]
    rows, wanted = [_rows(10, 2), _rows(20, 2)], [True, False]
    both, new = (jax.tree.map(lambda *x: jnp.stack(x), *trees) for trees in (rings, rows))
    both = jax.vmap(lambda r, n, w: replay.insert(r, n, wanted=w))(both, new, jnp.asarray(wanted))
    for i in range(2):
        alone = replay.insert(rings[i], rows[i], wanted=wanted[i])
        jax.tree.map(np.testing.assert_array_equal, jax.tree.map(lambda x, i=i: x[i], both), alone)


@pytest.mark.parametrize("seeds", [None, 3])
def test_a_donated_scan_of_insertions_needs_no_second_ring(seeds):
    """The compiled program's memory beside its arguments, which it overwrites."""

    def run(ring):
        def move(ring, first):
            ring = replay.insert(ring, _rows(first, 64), wanted=first < 5)
            return ring, replay.sample(ring, jax.random.key(0), 8)["a"]

        return jax.lax.scan(move, ring, jnp.arange(10))

    ring = replay.init(ROW, 64 * 1000)
    if seeds is not None:
        run, ring = jax.vmap(run), jax.tree.map(lambda x: jnp.stack([x] * seeds), ring)
    memory = jax.jit(run, donate_argnums=0).lower(ring).compile().memory_analysis()
    size = sum(x.nbytes for x in jax.tree.leaves(ring))
    assert memory.alias_size_in_bytes >= size
    assert memory.temp_size_in_bytes < 0.2 * size
