"""Mended boxes do not depend on where, how large, or in which order things are, or on hands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gril_jax.demos.formats.record import Box
from gril_jax.demos.tracking.hands import uncut
from gril_jax.demos.tracking.identities import linked
from gril_jax.demos.tracking.mending import Mended, closed, mended

FPS, FRAMES = 20.0, 50
SEEDS = st.integers(0, 2**32 - 1)
OFTEN = settings(max_examples=30, deadline=None)


def clean(seed, objects=3):
    """(T, N, 4): boxes of eighths of a pixel that rest, move steadily, and rest again."""
    rng = np.random.default_rng(seed)
    low, side = rng.integers(0, 4000, (objects, 2)), rng.integers(160, 800, (objects, 2))
    speed = rng.integers(-12, 13, (objects, 2))
    begin = rng.integers(0, FRAMES, objects)
    long = np.clip(np.arange(FRAMES)[:, None] - begin, 0, rng.integers(1, 30, objects))
    at = low + speed * long[..., None]
    return np.concatenate([at, at + side], axis=-1) / 8


def rough(seed, objects=3):
    """The same as a tracker sees it: jitter, gaps, and sightings of something else."""
    rng = np.random.default_rng([seed, 1])
    edges = clean(seed, objects) + rng.integers(-16, 17, (FRAMES, objects, 4)) / 8
    edges[rng.random((FRAMES, objects)) < 0.2] = np.nan
    away = rng.random((FRAMES, objects)) < 0.03
    return np.where(away[..., None], edges + 200.0, edges)


def same(one: Mended, other: Mended, edges=lambda x: x):
    np.testing.assert_array_equal(edges(one.edges), other.edges)
    assert (one.off, one.carried, one.smoothing) == (other.off, other.carried, other.smoothing)


@OFTEN
@given(seed=SEEDS)
def test_clean_boxes_stay_as_they_are_however_often_they_are_mended(seed):
    edges = clean(seed)
    found = mended(edges, FPS)
    np.testing.assert_array_equal(found.edges, edges)
    assert found.seen.all()
    assert (found.off, found.jitter, found.smoothing) == (0, 0.0, 1)
    same(found, mended(found.edges, FPS))


@OFTEN
@given(seed=SEEDS, power=st.integers(-2, 3))
def test_pictures_of_another_size_give_the_same_in_their_pixels(seed, power):
    edges, scale = rough(seed), 2.0**power
    given = {"jitter": 1.0, "smoothing": 5}
    other = mended(edges * scale, FPS, **given | {"jitter": scale})
    same(mended(edges, FPS, **given), other, lambda x: x * scale)


@OFTEN
@given(seed=SEEDS)
def test_a_mirrored_film_gives_the_mirrored_boxes(seed):
    edges = rough(seed)
    mirror = lambda x: x[..., [2, 1, 0, 3]] * [-1, 1, -1, 1]  # noqa: E731
    same(mended(edges, FPS), mended(mirror(edges), FPS), mirror)


@OFTEN
@given(seed=SEEDS, order=st.permutations(range(3)))
def test_the_order_of_objects_does_not_matter(seed, order):
    edges = rough(seed)
    same(mended(edges, FPS), mended(edges[:, order], FPS), lambda x: x[:, order])


@OFTEN
@given(seed=SEEDS, begin=st.integers(1, FRAMES - 8), bridged=st.integers(0, 10))
def test_gaps_of_a_steady_way_are_closed_exactly_if_they_are_short(seed, begin, bridged):
    rng = np.random.default_rng(seed)
    slope, first = rng.integers(-8, 9, (1, 2, 4)), rng.integers(0, 999, (1, 2, 4))
    line = (slope * np.arange(FRAMES)[:, None, None] + first).astype(float)
    gap = np.arange(begin, begin + int(rng.integers(1, 7)))
    seen = line.copy()
    seen[gap, 0] = np.nan
    found = closed(seen, bridged)
    there = line.copy()
    if len(gap) > bridged:
        there[gap, 0] = line[begin - 1, 0]
    np.testing.assert_allclose(found, there, atol=1e-9)
    np.testing.assert_array_equal(closed(found, bridged), found)


@OFTEN
@given(seed=SEEDS, tracker=st.booleans())
def test_objects_are_told_apart_in_whatever_order_a_frame_s_boxes_come(seed, tracker):
    """Things that are further apart than they are large, and move little from frame to frame."""
    rng = np.random.default_rng(seed)
    edges = clean(seed) + np.arange(3)[:, None] * 1500.0
    rows = [
        Box(t, "cup", tuple(edges[t, which].tolist()), 1.0, str(which) if tracker else None)
        for t in range(FRAMES)
        for which in rng.permutation(3)
    ]
    found = linked(rows, FRAMES, 3)
    assert (found.renewed, found.extra) == (0, 0)
    order = np.argsort(found.edges[0, :, 0])
    np.testing.assert_array_equal(found.edges[:, order], edges[:, np.argsort(edges[0, :, 0])])


PASSING = 90
BOX = np.array([200.0, 100.0, 260.0, 140.0])


def passed(begin=0.0, end=400.0, wide=80.0):
    """(T, 2, 4): a box at rest as a detector sees it, and a hand that passes over it."""
    x = np.linspace(begin, end, PASSING)
    hand = np.stack([x, np.full(PASSING, 60.0), x + wide, np.full(PASSING, 180.0)], axis=1)
    seen = np.tile(BOX, (PASSING, 1))
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
    half = np.linspace(30, 12, PASSING)
    middle = np.array([230.0, 120.0])
    edges[:, 0] = np.concatenate([middle - half[:, None], middle + half[:, None]], axis=1)
    edges[:20, 1] += [0, 400, 0, 400]
    edges[70:, 1] += [0, 400, 0, 400]
    found = uncut(edges, edges, [1])[:, 0]
    np.testing.assert_allclose((found[:, :2] + found[:, 2:]) / 2, np.tile(middle, (PASSING, 1)))


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
    edges = passed() + rng.normal(0, 2, (PASSING, 2, 4))
    found = mended(edges, 30.0, hands=[1])
    middle = (found.edges[:, 0, :2] + found.edges[:, 0, 2:]) / 2
    assert np.abs(middle - [230.0, 120.0]).max() < 4
    assert found.carried == 0
    without = mended(edges, 30.0)
    off = np.abs((without.edges[:, 0, :2] + without.edges[:, 0, 2:]) / 2 - [230.0, 120.0])
    assert off.max() > 10
