"""Matching of boundaries against scipy's assignment and brute force; stages shared by demos."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from gril_jax import subtasks
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.subtasks import matching

match_within = jax.jit(matching.match_within, static_argnames="tolerance")
match_in_order = jax.jit(matching.match_in_order)
place_in_order = jax.jit(matching.place_in_order)
shared_boundaries = jax.jit(matching.shared_boundaries)


def _padded(frames, size):
    return jnp.array([*frames, *[-1] * (size - len(frames))], jnp.int32)


def test_pairs_within_a_tolerance_are_scipys_best_assignment():
    rng = np.random.default_rng(0)
    for _ in range(60):
        sizes = rng.integers(0, 6, 2)
        found, true = (np.sort(rng.choice(40, n, replace=False)) for n in sizes)
        distance = np.abs(np.subtract.outer(found, true)).astype(float)
        rows, columns = scipy.optimize.linear_sum_assignment(np.where(distance <= 4, distance, 1e6))
        pairs = [distance[i, j] for i, j in zip(rows, columns, strict=True) if distance[i, j] <= 4]
        result = np.asarray(match_within(_padded(found, 6), _padded(true, 6), tolerance=4))
        ours = [distance[i, j] for i, j in enumerate(result) if j >= 0]
        assert len(ours) == len(pairs)
        np.testing.assert_allclose(sum(ours), sum(pairs), rtol=1e-6)


def test_nothing_is_paired_with_an_empty_list_or_too_far_off():
    empty, some = _padded([], 3), _padded([4, 9], 3)
    for found, true in ((empty, empty), (empty, some), (some, empty)):
        assert match_within(found, true).tolist() == [-1] * 3
    assert matching.match_within(some, jnp.zeros(0, jnp.int32)).tolist() == [-1] * 3
    assert match_within(some, some).tolist() == [0, 1, -1]
    assert match_within(some, _padded([40, 90], 3)).tolist() == [-1] * 3


def _f1(found, true):
    matched = np.sum(np.asarray(match_within(found, true, tolerance=5)) >= 0)
    return 2 * matched / (np.sum(found >= 0) + np.sum(true >= 0))


def _best_in_order(gain):
    rows, columns = gain.shape
    best = 0.0
    for n in range(1, min(rows, columns) + 1):
        for r in itertools.combinations(range(rows), n):
            for c in itertools.combinations(range(columns), n):
                if all(gain[i, j] > 0 for i, j in zip(r, c, strict=True)):
                    best = max(best, sum(gain[i, j] for i, j in zip(r, c, strict=True)))
    return best


def test_matching_in_order_has_the_largest_gain_of_all():
    rng = np.random.default_rng(1)
    for _ in range(30):
        gain = rng.normal(size=(4, 5)).astype(np.float32)
        match = np.asarray(match_in_order(jnp.asarray(gain)))
        pairs = [(i, j) for i, j in enumerate(match) if j >= 0]
        assert all(a[1] < b[1] for a, b in itertools.pairwise(pairs))
        total = sum(gain[i, j] for i, j in pairs)
        assert all(gain[i, j] > 0 for i, j in pairs)
        np.testing.assert_allclose(total, _best_in_order(gain), rtol=1e-5)


def test_placing_in_order_costs_least_of_all():
    rng = np.random.default_rng(2)
    for length in (3, 6):
        for _ in range(10):
            cost = rng.normal(size=(4, 6)).astype(np.float32)
            kept = np.array([True, True, False, True])
            placed = np.asarray(place_in_order(jnp.asarray(cost), jnp.asarray(kept), length))
            assert placed[2] == -1
            used = placed[kept]
            assert (np.diff(used) > 0).all()
            assert used[-1] < length
            best = min(
                sum(cost[kept][np.arange(3), list(c)])
                for c in itertools.combinations(range(length), 3)
            )
            np.testing.assert_allclose(cost[kept][np.arange(3), used].sum(), best, rtol=1e-5)


def test_more_rows_than_frames_share_the_last_frame():
    assert place_in_order(jnp.zeros((4, 6)), jnp.ones(4, bool), 2).tolist() == [0, 1, 1, 1]


def _staircases():
    """Three stages at other times in each of four demonstrations, seen through a reward."""
    ends = [[10, 20, 30], [12, 18, 34], [8, 22, 28], [11, 21, 36]]
    frames = np.arange(40)
    traces = [-1.0 + sum(frames >= e for e in row) / 3 for row in ends]
    return jnp.asarray(np.stack(traces), jnp.float32)[:, :, None], ends


def test_a_boundary_that_one_lacks_is_placed_and_one_that_only_one_has_is_dropped():
    features, ends = _staircases()
    found = [ends[0], ends[1], [8, 28], [5, 11, 21, 36]]
    found = jnp.stack([_padded(row, 5) for row in found])
    shared = shared_boundaries(features, found, tolerance=0.1)
    assert shared.kept.tolist() == [True, True, True, False, False]
    assert shared.frames[:, :3].tolist() == ends
    assert shared.frames[:, 3:].max() == -1
    assert shared.found[:, :3].tolist() == [[True] * 3, [True] * 3, [True, False, True], [True] * 3]
    np.testing.assert_allclose(shared.support, [1, 0.75, 1, 0, 0])


def test_padding_and_the_unit_of_the_features_change_nothing():
    features, ends = _staircases()
    found = jnp.stack([_padded(row, 4) for row in ends])
    expected = shared_boundaries(features, found, tolerance=0.1)
    padded = jnp.pad(features, ((0, 0), (0, 7), (0, 0)), constant_values=-0.3)
    shared = shared_boundaries(100 * padded, found, jnp.full(4, 40), tolerance=10.0)
    for a, b in zip(shared, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def test_nothing_found_anywhere_is_shared_by_nobody():
    features, _ = _staircases()
    shared = shared_boundaries(features, jnp.full((4, 3), -1), tolerance=0.1)
    assert not shared.kept.any()
    assert (shared.frames == -1).all()


def test_what_does_not_fit_is_named():
    features, _ = _staircases()
    with pytest.raises(ConfigError, match=r"tolerance is 0.0; it must be positive"):
        matching.shared_boundaries(features, jnp.zeros((4, 2), jnp.int32), tolerance=0.0)


def test_found_boundaries_are_as_good_as_those_of_ruptures():
    ruptures = pytest.importorskip("ruptures")
    rng = np.random.default_rng(0)
    ours, theirs = [], []
    for _ in range(6):
        true = np.cumsum(rng.integers(20, 40, 3))
        frames = np.arange(true[-1] + 25)
        trace = -1 + sum(np.clip((frames - e + 8) / 8, 0, 1) for e in true) / 3
        trace = (trace + rng.normal(0, 0.01, len(trace))).astype(np.float32)
        trace_padded = np.pad(trace, (0, 160 - len(trace)), mode="edge")
        marks = _detect(jnp.asarray(trace_padded))
        found = matching.boundary_frames(marks, 8)
        ours.append(_f1(found, jnp.asarray(true)))
        # mean shifts, told how many there are; a shift's best split lies inside the rise
        splits = ruptures.Dynp(model="l2", min_size=5).fit(trace).predict(n_bkps=3)[:-1]
        theirs.append(_f1(_padded(splits, 8), jnp.asarray(true)))
    assert np.mean(ours) >= np.mean(theirs)
    assert np.mean(ours) > 0.95


_detect = jax.jit(subtasks.transitions)


@pytest.mark.parametrize("shape", [(3, 2), (4,)])
def test_boundaries_of_other_demonstrations_are_refused(shape, monkeypatch):
    import jaxtyping

    features, _ = _staircases()
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        with pytest.raises(ShapeError, match="they must be"):
            matching.shared_boundaries(features, jnp.zeros(shape, int), tolerance=1.0)
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)
