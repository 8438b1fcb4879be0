"""Things in a hand: from the first motion with it until it leaves, always with whole boxes."""

import numpy as np
import pytest

from gril_jax.demos.tracking.held import with_held

HAND, CUP, BOWL = 0, 1, 2
TAKEN, LET_GO = 40, 80  # frames
SIZES = np.array([[0.3, 0.3], [0.14, 0.16], [0.2, 0.1]])


def story(takes=True):
    """Centres and sizes (T, 3, 2): a hand goes to a cup, brings it aside, and goes away."""
    stops = np.array([[-0.8, 0.7], [-0.3, 0.2], [-0.3, 0.2], [0.4, 0.4], [0.4, 0.2], [0.4, 0.2],
                      [0.8, 0.8]])  # fmt: skip
    at = np.array([0, 30, TAKEN, 65, 75, LET_GO, 110])
    hand = np.stack([np.interp(np.arange(120), at, stops[:, k]) for k in (0, 1)], axis=1)
    cup = hand[np.clip(np.arange(120), TAKEN, LET_GO) if takes else [TAKEN] * 120] - [0, 0.15]
    center = np.stack([hand, cup, np.broadcast_to([0.0, -0.6], cup.shape)], axis=1)
    return center, np.broadcast_to(SIZES, center.shape).copy()


def seen(center, size):
    """The same with the part of the cup cut that is behind the hand."""
    center, size = center.copy(), size.copy()
    low, high = center - size / 2, center + size / 2
    aside = (low[:, CUP, 0] < high[:, HAND, 0]) & (high[:, CUP, 0] > low[:, HAND, 0])
    top = np.where(aside, np.clip(low[:, HAND, 1], low[:, CUP, 1] + 0.02, high[:, CUP, 1]), np.inf)
    top = np.minimum(high[:, CUP, 1], top)
    center[:, CUP, 1], size[:, CUP, 1] = (low[:, CUP, 1] + top) / 2, top - low[:, CUP, 1]
    return center, size


def test_it_is_held_from_its_first_motion_until_the_hand_leaves():
    found = with_held(*seen(*story()), [HAND])
    frames = np.flatnonzero(found.held[:, CUP])
    assert TAKEN - 3 <= frames[0] <= TAKEN + 1
    assert LET_GO - 3 <= frames[-1] <= LET_GO + 3
    assert len(frames) == frames[-1] - frames[0] + 1
    assert not found.held[:, [HAND, BOWL]].any()


def test_its_box_is_whole_while_it_is_held_and_others_stay_as_they_are():
    center, size = story()
    given = seen(center, size)
    found = with_held(*given, [HAND])
    held = found.held[:, CUP]
    assert np.abs(given[1] - size)[held, CUP, 1].max() > 0.05
    np.testing.assert_allclose(found.center[held, CUP], center[held, CUP], atol=0.01)
    np.testing.assert_allclose(found.size[held, CUP], size[held, CUP], atol=0.01)
    for mine, theirs in zip(found[:2], given, strict=True):
        np.testing.assert_allclose(mine[~held], theirs[~held], atol=1e-6)


@pytest.mark.parametrize("scale", [0.1, 300.0])
def test_the_unit_does_not_matter(scale):
    center, size = seen(*story())
    one, other = with_held(center, size, [HAND]), with_held(center * scale, size * scale, [HAND])
    np.testing.assert_array_equal(one.held, other.held)
    np.testing.assert_allclose(one.center * scale, other.center, rtol=1e-4, atol=1e-5 * scale)


def test_a_hand_that_takes_nothing_holds_nothing():
    assert not with_held(*seen(*story(takes=False)), [HAND]).held.any()
    assert not with_held(*story(), []).held.any()


def test_what_no_frame_shows_in_between_is_with_the_hand():
    """The box of an unseen thing is the last one that was seen, wherever the hand is by then."""
    center, size = story()
    given = [x.copy() for x in seen(center, size)]
    for x in given:
        x[50:70, CUP] = x[50, CUP]
    found = with_held(*given, [HAND])
    assert found.held[TAKEN + 1 : LET_GO - 2, CUP].all()
    np.testing.assert_allclose(found.center[50:70, CUP], center[50:70, CUP], atol=0.03)


def test_parts_of_the_hand_that_are_not_seen_go_with_it():
    center, size = story()
    finger = center[:, HAND] - [0.0, 0.12]
    shown = finger.copy()
    shown[45:60] = shown[45]
    center = np.concatenate([center, shown[:, None]], axis=1)
    size = np.concatenate([size, np.full((120, 1, 2), 0.04)], axis=1)
    found = with_held(center, size, [HAND, 3])
    np.testing.assert_allclose(found.center[:, 3], finger, atol=0.01)


def test_jitter_is_no_motion():
    rng = np.random.default_rng(0)
    center, size = seen(*story())
    center = center + rng.normal(0, 0.004, center.shape)
    held = with_held(center, size, [HAND]).held
    assert held[TAKEN + 2 : LET_GO, CUP].mean() > 0.9
    assert held.sum() < 1.4 * (LET_GO - TAKEN)
