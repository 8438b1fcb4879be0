"""Final places of demonstrations: the reference is found, and costs are a loop's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.pretraining.edges import WIDTH
from gril_jax.pretraining.final_places import (
    FinalPlaces,
    astray,
    crowding,
    final_places,
    intrusion,
    misplacement,
)
from gril_jax.types import DemoBatch

REGION, ROBOT, BLOCK, IDLE, ABSENT = range(5)  # classes; the last is in no video
HALF = np.array([0.35, 0.25])  # of the region
COUNTED = jnp.arange(4) != ROBOT
LABEL = jnp.arange(4)


def _demos(*, idle_inside=0.0, num=200):
    """A block goes into the region, which stands anywhere; another one is left alone."""
    rng = np.random.default_rng(0)
    first = rng.uniform(-0.9, 0.9, (num, 4, 2))
    first[:, BLOCK] = first[:, REGION] + rng.choice([-1, 1], (num, 2)) * [0.8, 0.6]
    aside = rng.choice([-1, 1], (num, 2)) * rng.uniform(1.2, 2, (num, 2)) * HALF
    inside = rng.uniform(size=(num, 1)) < idle_inside
    first[:, IDLE] = first[:, REGION] + np.where(inside, 0.1 * aside, aside)
    last = first.copy()
    last[:, BLOCK] = last[:, REGION] + rng.uniform(-0.8, 0.8, (num, 2)) * HALF
    last[:, ROBOT] = rng.uniform(-0.9, 0.9, (num, 2))
    size = np.full((num, 4, 2), 0.2)
    size[:, REGION] = 2 * HALF
    frames = np.stack([first, last, last], axis=1)  # the third is padding
    return DemoBatch(
        center=jnp.asarray(frames, jnp.float32),
        size=jnp.asarray(np.repeat(size[:, None], 3, axis=1), jnp.float32),
        label=jnp.tile(LABEL, (num, 1)),
        is_robot=jnp.tile(LABEL == ROBOT, (num, 1)),
        present=jnp.ones((num, 4), bool),
        length=jnp.full(num, 2),
    )


@pytest.fixture(scope="module")
def demos():
    return _demos()


@pytest.fixture(scope="module")
def learn():
    return jax.jit(lambda d: final_places(d, 5))


@pytest.fixture(scope="module")
def places(demos, learn):
    return learn(demos)


def _scene(block, idle=(0.9, 0.9), region=(0.0, 0.0)):
    center = jnp.array([region, (-0.9, -0.9), block, idle], jnp.float32)
    return center, jnp.full((4, 2), 0.2).at[REGION].set(2 * jnp.asarray(HALF)), LABEL


def test_the_reference_is_what_a_moved_object_has_a_fixed_relation_to(places):
    assert int(places.reference[BLOCK]) == REGION
    assert places.placed.tolist() == [c == BLOCK for c in range(5)]


def test_the_box_holds_all_ends_but_a_tenth_on_each_side(demos, places):
    last = np.asarray(demos.center[:, 1], np.float64)
    offset = (last[:, BLOCK] - last[:, REGION]) / (2 * HALF)
    low, high = np.quantile(offset, [0.1, 0.9], axis=0)
    np.testing.assert_allclose(places.low[BLOCK], low, atol=1e-5)
    np.testing.assert_allclose(places.high[BLOCK], high, atol=1e-5)


def test_turned_scenes_have_a_box_with_the_symmetries_of_the_square(demos):
    turned = jax.jit(lambda demos: final_places(demos, 5, turned=True))(demos)
    low, high = np.asarray(turned.low[BLOCK]), np.asarray(turned.high[BLOCK])
    np.testing.assert_allclose(high, high[::-1], atol=1e-6)
    np.testing.assert_allclose(low, -high, atol=1e-6)


def test_the_journey_is_the_mean_distance_from_place_at_the_start(demos, places):
    begin = jax.vmap(astray, (None, 0, 0, 0))(
        places, demos.center[:, 0], demos.size[:, 0], demos.label
    )
    assert float(places.journey) == pytest.approx(float(begin[:, BLOCK].mean()), rel=1e-5)


def test_what_is_left_alone_outside_is_an_intruder_inside(places, learn):
    assert bool(places.intruder[IDLE])
    assert not bool(places.intruder[BLOCK])
    # Where one in four stands in the region anyway, it does no harm there.
    assert not bool(learn(_demos(idle_inside=0.25)).intruder[IDLE])


def test_distances_from_the_box_are_those_of_plain_arithmetic(places):
    rng = np.random.default_rng(1)
    low, high = (np.asarray(x[BLOCK], np.float64) * 2 * HALF for x in (places.low, places.high))
    for _ in range(10):
        block, idle, region = rng.uniform(-1, 1, (3, 2))
        scene = _scene(block, idle, region)
        away = np.linalg.norm((block - region) - np.clip(block - region, low, high))
        np.testing.assert_allclose(astray(places, *scene), [0, 0, away, 0], atol=1e-5)
        depth = max(np.minimum(idle - region - low, high - (idle - region)).min(), 0)
        np.testing.assert_allclose(intrusion(places, *scene), [0, 0, 0, depth], atol=1e-5)


def test_the_box_scales_with_the_references(places):
    center, size, label = _scene((0.5, 0.0))
    assert float(astray(places, center, size, label)[BLOCK]) > 0.1
    assert float(astray(places, center, size.at[REGION].set(2.0), label)[BLOCK]) == 0


def test_a_scene_without_the_reference_has_nothing_out_of_place(places):
    label = jnp.array([ABSENT, BLOCK])
    none = astray(places, jnp.ones((2, 2)), jnp.ones((2, 2)), label)
    np.testing.assert_array_equal(none, 0)


def _cost(places, scene, moved=True, **weights):
    active = jnp.full(4, moved)
    return float(misplacement(places, *scene, COUNTED, active, **weights))


def test_an_end_costs_nothing_and_a_beginning_about_one(demos, places):
    cost = jax.vmap(lambda c, s: misplacement(places, c, s, LABEL, COUNTED, jnp.ones(4, bool)))
    assert float(cost(demos.center[:, 0], demos.size[:, 0]).mean()) == pytest.approx(1.0, abs=0.02)
    assert float(jnp.median(cost(demos.center[:, 1], demos.size[:, 1]))) == 0


def test_the_near_share_is_due_half_a_box_away_and_the_rest_by_the_distance(places):
    edge = float(places.high[BLOCK][0]) * 2 * HALF[0]
    half = 0.1 * np.sqrt(2)
    for away in (0.5 * half, half, 2 * half):
        expected = 0.7 * min(away / half, 1) + 0.3 * away / float(places.journey)
        found = _cost(places, _scene((edge + away, 0.0)), near_cost_fraction=0.7)
        assert found == pytest.approx(expected, abs=1e-5)


@pytest.fixture(scope="module")
def anywhere(demos):
    return jax.jit(lambda d: final_places(d, 5, anywhere_inside=True))(demos)


def test_what_ends_well_inside_belongs_anywhere_inside(demos, anywhere, places):
    assert anywhere.within.tolist() == [c == BLOCK for c in range(5)]
    assert not places.within.any()
    np.testing.assert_allclose(anywhere.low[BLOCK], -0.5)
    np.testing.assert_allclose(anywhere.high[BLOCK], 0.5)
    shifted = demos._replace(center=demos.center.at[:, 1:, BLOCK, 0].add(2.0 * HALF[0]))
    beside = jax.jit(lambda d: final_places(d, 5, anywhere_inside=True))(shifted)
    assert not beside.within.any()  # the ends lie across an edge of the region


def test_the_near_share_is_due_where_a_centre_crosses_the_edge(anywhere):
    rng = np.random.default_rng(2)
    for block in rng.uniform(-0.6, 0.6, (20, 2)):
        out = np.clip((np.abs(block) - HALF).max() / (2 * WIDTH * 0.1) + 0.5, 0, 1)
        away = np.linalg.norm(np.maximum(np.abs(block) - HALF, 0))
        expected = 0.7 * out + 0.3 * away / float(anywhere.journey)
        assert _cost(anywhere, _scene(block), near_cost_fraction=0.7) == pytest.approx(
            expected, abs=1e-5
        )


def test_whatever_is_in_place_costs_less_than_whatever_is_not(anywhere):
    rng = np.random.default_rng(3)
    blocks = rng.uniform(-0.5, 0.5, (200, 2))
    cost = np.array([_cost(anywhere, _scene(block)) for block in blocks[:60]])
    inside = (np.abs(blocks[:60]) < HALF).all(axis=1)
    assert cost[inside].max() <= cost[~inside].min()
    # It is flat inside: all that is further from the edge than WIDTH halves of the box costs 0.
    assert not cost[(np.abs(blocks[:60]) < HALF - WIDTH * 0.1).all(axis=1)].any()


def test_an_intruder_costs_its_share(places):
    assert _cost(places, _scene((0, 0), idle=(0, 0)), intrusion_weight=0.3) == pytest.approx(
        0.3, abs=1e-6
    )


def test_an_intruder_costs_as_soon_as_its_centre_is_in(anywhere):
    near = [
        _cost(anywhere, _scene((0, 0), idle=(HALF[0] + away, 0))) for away in (-0.04, 0.0, 0.04)
    ]
    assert near == pytest.approx([0.5, 0.25, 0.0], abs=1e-5)


def test_what_has_not_been_touched_costs_a_little_more(places):
    scene = _scene((0.8, 0.6))
    touched = _cost(places, scene, touch=0.1)
    assert _cost(places, scene, moved=False, touch=0.1) == pytest.approx(touched + 0.1, abs=1e-6)
    assert _cost(places, scene) == pytest.approx(touched / 0.9, abs=1e-5)


def test_robots_and_padding_cost_nothing(places):
    center, size, label = _scene((0.9, 0.9))
    none = misplacement(places, center, size, label, jnp.zeros(4, bool), jnp.ones(4, bool))
    assert float(none) == 0


def test_gradients_are_finite_in_place_and_at_corners(places):
    for block in ((0.0, 0.0), (0.9, 0.9)):
        center, size, label = _scene(block)
        slope = jax.grad(
            lambda c, s=size, n=label: misplacement(places, c, s, n, COUNTED, jnp.ones(4, bool))
        )(center)
        assert np.isfinite(np.asarray(slope)).all()


def test_demonstrations_that_move_nothing_place_nothing(demos, learn):
    still = demos._replace(center=demos.center.at[:, 1:].set(demos.center[:, :1]))
    places = learn(still)
    assert isinstance(places, FinalPlaces)
    assert not places.placed.any()
    assert _cost(places, _scene((0.9, 0.9))) == 0


def test_an_intruder_that_must_keep_clear_costs_by_its_distance(places):
    """Against a loop over the box's nearest point."""
    low, high = (np.asarray(x)[BLOCK] for x in (places.low, places.high))
    size, clear = np.array([0.2, 0.2]), 2.0
    half = np.linalg.norm(size) / 2
    for idle in np.random.default_rng(0).uniform(-0.9, 0.9, (40, 2)):
        scene = _scene((0, 0), idle=idle)
        box = [low * 2 * HALF, high * 2 * HALF]
        away = np.linalg.norm(idle - np.clip(idle, *box))
        expected = max(0.0, 1 - away / (clear * half))
        found = np.asarray(crowding(places, *scene, clearance_radius=clear))
        np.testing.assert_allclose(found[IDLE], expected, atol=1e-5)
        assert found[[REGION, ROBOT, BLOCK]].tolist() == [0, 0, 0]
        assert _cost(places, scene, intrusion_weight=1.0, clearance_radius=clear) == pytest.approx(
            expected, abs=1e-5
        )


@pytest.mark.parametrize("tails", [0.02, 0.25])
def test_a_box_leaves_out_the_tails_that_it_is_told(demos, tails):
    found = jax.jit(lambda d: final_places(d, 5, trim_quantile=tails))(demos)
    last = np.asarray(demos.center[:, 1])
    offset = (last[:, BLOCK] - last[:, REGION]) / (2 * HALF)
    np.testing.assert_allclose(found.low[BLOCK], np.quantile(offset, tails, axis=0), atol=1e-3)
    np.testing.assert_allclose(found.high[BLOCK], np.quantile(offset, 1 - tails, axis=0), atol=1e-3)


def test_what_is_brought_into_a_thing_belongs_there_and_not_beside_a_larger_one():
    """A tray and a bin that turn together: of the tray's size, blocks' places differ less."""
    rng, num = np.random.default_rng(0), 100
    turn = rng.uniform(-0.4, 0.4, num)
    away = 0.25 * np.stack([np.sin(turn), -np.cos(turn)], axis=1)
    tray = rng.uniform(-0.1, 0.1, (num, 2))
    tray_class, bin_class, block = range(3)
    last = np.stack([tray, tray + away, tray + away + rng.uniform(-0.06, 0.06, (num, 2))], axis=1)
    first = last.copy()
    first[:, block] = tray + rng.uniform(-0.1, 0.1, (num, 2))
    sizes = np.array([[0.55, 0.55], [0.2, 0.2], [0.07, 0.07]])
    demos = DemoBatch(
        center=jnp.asarray(np.stack([first, last], axis=1), jnp.float32),
        size=jnp.asarray(np.tile(sizes, (num, 2, 1, 1)), jnp.float32),
        label=jnp.tile(jnp.arange(3), (num, 1)),
        is_robot=jnp.zeros((num, 3), bool),
        present=jnp.ones((num, 3), bool),
        length=jnp.full(num, 2),
    )
    found = jax.jit(lambda d: final_places(d, 3))(demos)
    assert int(found.reference[block]) == bin_class
    assert bool(found.placed[block])
    assert not np.asarray(found.placed)[[tray_class, bin_class]].any()
