"""Boxes that a detector lost, and boxes in other units: defined answers, never NaN."""

import dataclasses
import functools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.saved_rewards import CLASSES, CONFIGS, OBJECTS, boxes, made

from gril_jax.errors import ConfigError
from gril_jax.graphs import activity
from gril_jax.graphs.activity_rule import ActivityRule
from gril_jax.reward.learned_reward import NOTHING_SEEN, LearnedReward

ROBOT = OBJECTS.index("robot")
ACTIVE = jnp.array([False, True, True, False, False])
CENTER, SIZE = (x[0] for x in boxes(1))
LOST = (np.nan, np.inf, -np.inf)
KINDS = ["paper", "interaction", "ensemble", "mlp"]


@functools.cache
def _learned(kind="paper", half_extent=None):
    config = CONFIGS[kind]
    about = json.dumps({"half_extent": half_extent})
    return LearnedReward(
        made(config), config, CLASSES, ("robot",), OBJECTS, ActivityRule(0.5, 2), about
    )


@functools.cache
def _value(kind):
    learned = _learned(kind)
    return jax.jit(lambda c, s, present: learned(c, s, ACTIVE, present=present))


@functools.cache
def _slope(kind):
    learned = _learned(kind)
    return jax.jit(jax.grad(lambda c, s: learned(c, s, ACTIVE), argnums=(0, 1)))


@pytest.mark.parametrize("kind", KINDS)
def test_an_object_without_a_finite_box_counts_as_not_present(kind):
    @settings(max_examples=60, deadline=None)
    @given(
        st.sets(st.integers(0, 4), min_size=1, max_size=3),
        st.sampled_from(LOST),
        st.tuples(st.booleans(), st.integers(0, 1)),
    )
    def check(lost, value, place):
        which, (in_size, axis) = np.array([*lost]), place
        center, size = np.array(CENTER), np.array(SIZE)
        (size if in_size else center)[which, axis] = value
        found = _value(kind)(center, size, np.ones(5, bool))
        absent = _value(kind)(CENTER, SIZE, ~np.isin(np.arange(5), which))
        np.testing.assert_allclose(found, absent, rtol=1e-5)
        assert all(np.isfinite(x).all() for x in _slope(kind)(center, size))

    check()


@pytest.mark.parametrize("kind", KINDS)
def test_an_object_without_a_size_counts_as_not_present(kind):
    learned, absent = _learned(kind), np.arange(5) == 3
    value = jax.jit(lambda size: learned(CENTER, size, ACTIVE))
    size = np.where(absent[:, None], 0.0, SIZE).astype(np.float32)
    np.testing.assert_allclose(value(size), _value(kind)(CENTER, SIZE, ~absent), rtol=1e-5)
    assert value(size) != value(np.asarray(SIZE))
    assert value(np.zeros_like(SIZE)) == NOTHING_SEEN


@pytest.mark.parametrize("kind", KINDS)
def test_where_nothing_is_left_the_reward_is_the_documented_one(kind):
    learned, none = _learned(kind), np.full((5, 2), np.nan, np.float32)
    assert _value(kind)(none, SIZE, np.ones(5, bool)) == NOTHING_SEEN
    robot_alone = np.where(np.arange(5)[:, None] == ROBOT, CENTER, np.nan)
    counts = getattr(learned.config, "pool_robot", True)
    found = _value(kind)(robot_alone, SIZE, np.ones(5, bool))
    assert (found == NOTHING_SEEN) == (not counts)
    assert np.isfinite(found)
    # Padding is not lost: without any object the reward is as it was.
    assert _value(kind)(CENTER, SIZE, np.zeros(5, bool)) != NOTHING_SEEN


def test_a_lost_object_stays_where_it_was_last_seen():
    center, size = (np.array(x) for x in boxes(9))
    center[3:5, 2], size[6], center[8, 1, 0] = np.nan, np.nan, np.inf
    held = center.copy(), size.copy()
    for t in range(1, 9):
        lost = ~(np.isfinite(center[t]).all(axis=-1) & np.isfinite(size[t]).all(axis=-1))
        for boxes_held in held:
            boxes_held[t, lost] = boxes_held[t - 1, lost]
    trajectory = jax.jit(_learned().trajectory)
    np.testing.assert_array_equal(trajectory(center, size), trajectory(*held))


def test_an_object_that_is_seen_late_is_not_present_before():
    center, size = (np.array(x) for x in boxes(4))
    center[:2, 3] = np.nan
    learned, present = _learned(), np.arange(5) != 3
    memory = learned.init(*(jnp.asarray(x[0]) for x in (center, size)))
    step = jax.jit(learned.step)
    for t in range(1, 4):
        memory, found = step(memory, center[t], size[t])
        there = present | (t > 1)
        filled = np.nan_to_num(center[t])
        expected = jax.jit(learned)(filled, size[t], memory.activity.active, present=there)
        np.testing.assert_allclose(found, expected, rtol=1e-5)
    everything = np.full_like(center, np.nan)
    assert (np.asarray(jax.jit(learned.trajectory)(everything, size)) == NOTHING_SEEN).all()


def test_a_lost_box_has_not_moved():
    size = np.asarray(boxes(9)[1])
    still = np.tile(np.asarray(CENTER), (9, 1, 1))
    still[2, 1], still[5:7, 2], still[0, 3] = np.nan, np.inf, -np.inf
    for options in ({}, {"smoothing": 3}, {"noise": 0.01}):
        run = functools.partial(activity.trajectory, tau=0.1, window=2, **options)
        assert not jax.jit(run)(still, size[:1].repeat(9, axis=0)).any()


def test_a_real_move_is_seen_beside_lost_boxes_in_both_forms():
    center, size = (np.array(x) for x in boxes(9))
    center[4, 1] = np.inf
    rule = ActivityRule(0.5, 2)
    memory, step = rule.init(jnp.asarray(center[0])), jax.jit(rule.step)
    bits = [memory.active]
    for frame in zip(center[1:], size[1:], strict=True):
        memory, active = step(memory, *frame)
        bits.append(active)
    whole = jax.jit(lambda *x: activity.trajectory(*x, tau=0.5, window=2))(center, size)
    np.testing.assert_array_equal(bits, whole)
    assert whole[-1, 1]


@pytest.mark.parametrize(
    "call",
    [
        lambda r, c, s: r(c, s, ACTIVE),
        lambda r, c, s: r.init(c, s),
        lambda r, c, s: r.step(r.init(c / 640, s / 640), c, s),
        lambda r, c, s: r.trajectory(c[None], s[None]),
    ],
)
def test_raw_pixels_are_refused_where_it_can_be_told(call):
    pixels = jnp.array(CENTER) * 100 + 320, jnp.full((5, 2), 40.0)
    sentence = r"holds [\d.]+, but the reward's scenes reach 1\.1 world units.*boxes_from_pixels"
    with pytest.raises(ConfigError, match=sentence):
        call(_learned(half_extent=1.1), *pixels)


def test_world_units_lost_boxes_traced_boxes_and_unknown_extents_pass():
    learned = _learned(half_extent=1.1)
    assert np.isfinite(learned(CENTER, SIZE, ACTIVE))
    assert np.isfinite(learned(CENTER.at[0].set(jnp.inf), SIZE, ACTIVE))
    far = 500.0 * CENTER
    assert np.isfinite(jax.jit(lambda c: learned(c, SIZE, ACTIVE))(far))
    assert np.isfinite(dataclasses.replace(learned, description="{}")(far, SIZE, ACTIVE))
