"""Boxes become objects: who is who from frame to frame, what is mended, what a detector needs."""

import numpy as np
import pytest

from gril_jax.demos.formats.record import Box
from gril_jax.demos.tracking.identities import in_order, linked, objects_at_once
from gril_jax.demos.tracking.mending import away, jitter_of, lone, mended

FRAMES = 60


def at(frame, x, y=0.0, name="cup", track=None, side=20.0):
    return Box(frame, name, (x, y, x + side, y + side), 1.0, track)


def two_that_meet():
    """Two cups that pass each other, 30 pixels apart; rows in a random order of each frame."""
    rng = np.random.default_rng(0)
    for t in range(FRAMES):
        pair = [at(t, 5.0 * t, 0.0), at(t, 300 - 5.0 * t, 30.0)]
        yield from (pair if rng.random() < 0.5 else pair[::-1])


def x_of(edges):
    return edges[..., 0]


@pytest.mark.parametrize("gaps", [FRAMES, 7, 3])
def test_objects_of_a_class_keep_their_identity_where_they_pass_each_other(gaps):
    found = linked([one for one in two_that_meet() if one.frame % gaps != 1], FRAMES, 2)
    y = found.edges[:, :, 1]
    assert (np.nanmax(y, axis=0) == np.nanmin(y, axis=0)).all()
    assert sorted(y[0].tolist()) == [0.0, 30.0]
    assert (found.renewed, found.extra) == (0, 0)


@pytest.mark.parametrize("off", [0.0, 2.0])
def test_a_small_thing_that_is_brought_over_a_large_one_stays_itself(off):
    """Both of one class, and with their middles in one place at last, as a spoon in a cup."""
    rng = np.random.default_rng(0)
    boxes = []
    for t in range(FRAMES):
        x, y = rng.normal(0, off, 2) + [max(300 - 10.0 * t, 0), 0]
        pair = [at(t, -20.0, -20.0, side=60.0), at(t, x, y)]
        boxes += pair if rng.random() < 0.5 else pair[::-1]
    edges = linked(boxes, FRAMES, 2).edges
    wide = edges[..., 2] - edges[..., 0]
    np.testing.assert_allclose(wide.max(axis=0), wide.min(axis=0))
    np.testing.assert_allclose(sorted(wide[0]), [20.0, 60.0])


def test_a_tracker_s_identity_decides_between_two_that_are_equally_near():
    boxes = [at(0, 0.0, track="1"), at(0, 40.0, track="2")]
    boxes += [at(1, 20.0, y=1.0, track="2"), at(1, 20.0, y=-1.0, track="1")]
    edges = linked(boxes, 2, 2).edges
    assert edges[1, :, 1].tolist() == [-1.0, 1.0]


def test_an_object_counts_if_a_fifth_of_the_frames_show_it():
    boxes = [at(t, 0.0) for t in range(10)] + [at(0, 50.0)]
    assert objects_at_once(boxes) == {"cup": 1}
    found = linked(boxes, 10, 1)
    assert found.extra == 1
    assert x_of(found.edges[:, 0]).tolist() == [0.0] * 10
    assert objects_at_once([*boxes, at(1, 50.0), at(2, 50.0)]) == {"cup": 2}


def test_one_that_comes_late_is_another_object_and_a_renewed_identity_is_not():
    boxes = [at(t, 0.0, track=str(t // 5)) for t in range(10)]
    boxes += [at(t, 200.0, track="9") for t in range(4, 10)]
    found = linked(boxes, 10, 2)
    assert found.renewed == 1
    assert np.isnan(found.edges[:4, 1]).all()
    assert x_of(found.edges[4:, 1]).tolist() == [200.0] * 6


def path(jitter=0.0, seed=0):
    """(T, 2, 4): one at rest, one that moves for two seconds; and the truth."""
    rng = np.random.default_rng(seed)
    x = np.clip(np.arange(120) - 30, 0, 60) * 4.0
    low = np.stack([np.stack([np.full(120, 50.0), x], 1), np.full((120, 2), 80.0)], axis=-1)
    true = np.concatenate([low, low + 60.0], axis=-1)
    return true + jitter * rng.normal(size=true.shape), true


def test_jitter_is_measured_in_pixels_whatever_moves():
    for sd in (0.0, 1.0, 3.0):
        centre = sd / np.sqrt(2)  # of the mean of two edges
        assert jitter_of(path(sd)[0]) == pytest.approx(centre, rel=0.15, abs=0.05)


def test_mending_leaves_out_what_is_of_another_object_and_fills_gaps():
    edges, true = path(2.0)
    rng = np.random.default_rng(1)
    edges[rng.random(edges.shape[:2]) < 0.1] = np.nan
    edges[20, 0], edges[70, 0] = true[20, 1] + 200, true[70, 1] + 90
    found = mended(edges, 30.0)
    assert not found.seen[[20, 70], 0].any()
    assert 2 <= found.off <= 4
    centre = lambda x: (x[..., :2] + x[..., 2:]) / 2  # noqa: E731
    off = np.linalg.norm(centre(found.edges) - centre(true), axis=-1)
    assert np.median(off) < 1.0
    assert off.max() < 8.0  # where it starts and stops
    assert found.smoothing == 9


def test_objects_of_a_class_are_in_one_order_in_every_film():
    edges = np.tile(np.array([0.0, 0.0, 20.0, 20.0]), (FRAMES, 5, 1))
    for which, x in enumerate((300.0, 100.0, 200.0, 50.0)):
        edges[:, which, [0, 2]] += x
    edges[30:, 0] += 40.0  # moves second
    edges[10:, 2] += 40.0  # moves first
    edges[:, 4] = np.nan  # never seen
    assert in_order(edges).tolist() == [2, 0, 3, 1, 4]


def carried_out_of_sight(fps=30.0):
    """(T, 2, 4): what a hand covers from before it takes it until after it lets go, and the hand;
    and the truth."""
    at = np.arange(210) / fps
    way = np.clip((at - 2.0) / 1.5, 0, 1)
    way = way * way * (3 - 2 * way)
    thing = 100.0 + 240.0 * way
    hand = np.where(at < 1.5, 100.0 + 200 * (1.5 - at), thing)
    hand = np.where(at > 4.0, 340.0 - 200 * (at - 4.0), hand)
    true = np.stack([np.stack([x - half, np.full(210, 200.0 - half), x + half,
                               np.full(210, 200.0 + half)], axis=1)
                     for x, half in ((thing, 30.0), (hand, 45.0))], axis=1)  # fmt: skip
    seen = true.copy()
    seen[(np.abs(thing - hand) < 30), 0] = np.nan
    return seen, true


def test_what_a_hand_hides_goes_with_it_and_rests_where_it_is_put_down():
    edges, true = carried_out_of_sight()
    assert np.isnan(edges[:, 0]).any(axis=-1).sum() > 80
    found = mended(edges, 30.0, hands=[1])
    assert found.carried == 1
    assert np.abs(found.edges[:, 0] - true[:, 0]).max() < 6
    without = mended(edges, 30.0)
    assert without.carried == 0
    assert np.abs(without.edges[:, 0] - true[:, 0]).max() > 200


def test_what_moved_another_way_than_the_hand_is_not_taken_for_carried():
    edges, _ = carried_out_of_sight()
    edges[100:, 0] += [0.0, 200.0, 0.0, 200.0]  # it lies where the hand has never been
    assert mended(edges, 30.0, hands=[1]).carried == 0
    assert mended(edges, 30.0, hands=[0]).carried == 0


def test_a_lone_sighting_elsewhere_is_left_out_and_the_first_ones_stay():
    edges, true = carried_out_of_sight()
    gap = np.flatnonzero(np.isnan(edges[:, 0, 0]))
    edges[gap[20], 0] = [500.0, 20.0, 560.0, 80.0]
    found = mended(edges, 30.0, hands=[1])
    assert (found.off, found.carried) == (1, 1)
    assert np.abs(found.edges[:, 0] - true[:, 0]).max() < 6
    assert not lone(true, 9).any()


def test_an_arm_that_reaches_into_the_picture_carries_by_its_hand():
    """Its box ends at the picture's edge, so that its middle goes half as far as the hand."""
    edges, true = carried_out_of_sight()
    edges[:, 1, 0] = 0.0
    found = mended(edges, 30.0, hands=[1])
    assert found.carried == 1
    assert np.abs(found.edges[:, 0] - true[:, 0]).max() < 6


def test_of_two_ways_to_explain_a_gap_the_hand_stood_still_where_it_let_go():
    """It brings the object and leaves the same way: the object was not taken along at the end."""
    at = np.arange(180) / 30.0
    way = lambda begin: (x := np.clip((at - begin) / 0.8, 0, 1)) * x * (3 - 2 * x)  # noqa: E731
    thing = 100.0 + 90.0 * way(1.5)
    hand = 100.0 + 90.0 * way(1.5) + 110.0 * way(3.5)
    boxes = np.stack([np.stack([x - half, np.full(180, 200.0 - half), x + half,
                                np.full(180, 200.0 + half)], axis=1)
                      for x, half in ((thing, 20.0), (hand, 80.0))], axis=1)  # fmt: skip
    seen = boxes.copy()
    seen[(at > 0.3) & (hand - thing < 95), 0] = np.nan
    found = mended(seen, 30.0, hands=[1])
    assert found.carried == 1
    assert np.abs(found.edges[:, 0] - boxes[:, 0]).max() < 6


def test_sightings_of_another_between_a_jump_and_one_back_are_left_out():
    edges, true = path()
    edges[60:66, [0, 1]] = edges[60:66, [1, 0]]
    edges[90:94, 0] = true[90:94, 0] + np.array([-40.0, -40.0, 40.0, 40.0])  # where it lies, larger
    off = away(edges, 9)
    assert np.flatnonzero(off[:, 0]).tolist() == [*range(60, 66), *range(90, 94)]
    assert np.flatnonzero(off[:, 1]).tolist() == [*range(60, 66)]
    assert not away(edges, 3)[60:66].any()
    assert not away(true, 9).any()
    hidden = true.copy()
    hidden[30:60, 1] = np.nan
    hidden[60:64, 1] += [0.0, 200.0, 0.0, 200.0]
    assert np.flatnonzero(away(hidden, 9)[:, 1]).tolist() == [*range(60, 64)]
    edges[66:, 0] += 300.0  # it stays there: it has been moved out of sight
    assert not away(edges, 9)[66:85].any()


def test_a_tracker_that_does_not_know_for_a_time_renews_no_identity():
    tracks = ["1", None, "1", None, "2"]
    found = linked([at(t, 0.0, track=track) for t, track in enumerate(tracks)], 5, 1)
    assert found.renewed == 1
