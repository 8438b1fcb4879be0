"""Boxes that shrink under a hand are as large as they were, and strips say nothing."""

import numpy as np
import pytest

from gril_jax.demos.tracking.hands import uncut
from gril_jax.demos.tracking.mending import mended

FRAMES = 90
BOX = np.array([200.0, 100.0, 260.0, 140.0])


def passed(begin=0.0, end=400.0, wide=80.0):
    """(T, 2, 4): a box at rest as a detector sees it, and a hand that passes over it."""
    x = np.linspace(begin, end, FRAMES)
    hand = np.stack([x, np.full(FRAMES, 60.0), x + wide, np.full(FRAMES, 180.0)], axis=1)
    seen = np.tile(BOX, (FRAMES, 1))
    left, right = hand[:, 0], hand[:, 2]
    over_right = (left < BOX[2]) & (right >= BOX[2])
    over_left = (right > BOX[0]) & (left <= BOX[0])
    seen[over_right, 2] = np.maximum(left[over_right], BOX[0])
    seen[over_left, 0] = np.minimum(right[over_left], BOX[2])
    seen[over_left & over_right] = np.nan
    seen[seen[:, 2] - seen[:, 0] < 2] = np.nan
    return np.stack([seen, hand], axis=1)


def test_what_a_hand_cuts_is_as_large_as_it_was_and_stays_where_it_lies():
    edges = passed()
    cut = edges[:, 0, 2] - edges[:, 0, 0] < 59
    found = uncut(edges, edges, [1])
    known = ~np.isnan(found[:, 0, 0])
    assert (cut & known).sum() >= 8
    assert np.abs(found[known, 0] - BOX).max() < 60 * 0.15
    strips = edges[:, 0, 2] - edges[:, 0, 0] < 0.3 * 60
    assert strips.any()
    assert not (known & strips).any()
    np.testing.assert_array_equal(found[:, 1], edges[:, 1])


def test_what_is_small_because_it_is_far_away_is_not_cut():
    edges = passed(begin=210.0, end=230.0)
    half = np.linspace(30, 12, FRAMES)
    middle = np.array([230.0, 120.0])
    edges[:, 0] = np.concatenate([middle - half[:, None], middle + half[:, None]], axis=1)
    edges[:20, 1] += [0, 400, 0, 400]
    edges[70:, 1] += [0, 400, 0, 400]
    found = uncut(edges, edges, [1])[:, 0]
    np.testing.assert_allclose((found[:, :2] + found[:, 2:]) / 2, np.tile(middle, (FRAMES, 1)))


@pytest.mark.parametrize("hands", [[], [1]])
def test_without_a_hand_or_without_a_free_sighting_boxes_stay(hands):
    edges = passed(begin=150.0, end=240.0) if hands else passed()
    np.testing.assert_array_equal(uncut(edges, edges, hands), edges)
    gone = edges.copy()
    gone[:, 0] = np.nan
    np.testing.assert_array_equal(uncut(gone, gone, hands), gone)


@pytest.mark.parametrize("seed", range(3))
def test_a_hand_that_passes_over_an_object_does_not_move_it(seed):
    rng = np.random.default_rng(seed)
    edges = passed() + rng.normal(0, 2, (FRAMES, 2, 4))
    found = mended(edges, 30.0, hands=[1])
    middle = (found.edges[:, 0, :2] + found.edges[:, 0, 2:]) / 2
    assert np.abs(middle - [230.0, 120.0]).max() < 4
    assert found.carried == 0
    without = mended(edges, 30.0)
    off = np.abs((without.edges[:, 0, :2] + without.edges[:, 0, 2:]) / 2 - [230.0, 120.0])
    assert off.max() > 10
