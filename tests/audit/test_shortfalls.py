"""Kinds of shortfall: which state is of which, with margins of two pixels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.audit_tasks import START, one_shoe, shoes, start

from gril_jax.audit.shortfalls import KINDS, UNCLEAR, is_clear_success, kind_of, margin

TWO, MARGIN = shoes(2, 3), 2 / 48  # of a plane |x|, |y| <= 1
A, B, STONE = 2, 3, 4
IN, ALSO_IN, EDGE = (0.5, 0.5), (0.4, 0.6), 0.25  # the box is from 0.25 to 0.75
_kind = jax.jit(lambda center, active: kind_of(TWO, start(), center, active))


def _state(places, touched=()):
    center = np.array(START)
    for index, place in places.items():
        center[index] = place
    active = (center != np.asarray(START)).any(axis=1)
    active[list(touched)] = True
    return jnp.asarray(center), jnp.asarray(active)


@pytest.mark.parametrize(
    ("kind", "places", "touched"),
    [
        ("nothing done", {}, ()),
        ("nothing done", {A: (-0.5, -0.5)}, (B,)),
        ("part missing", {A: IN}, ()),
        ("part undone", {A: IN}, (B,)),
        ("part undone", {A: IN, B: (EDGE - 2.1 * MARGIN, 0.5)}, ()),
        ("just outside", {A: IN, B: (EDGE - 1.9 * MARGIN, 0.5)}, ()),
        ("just outside", {A: IN, B: (EDGE - 1.1 * MARGIN, 0.5)}, ()),
        (None, {A: IN, B: (EDGE - 0.9 * MARGIN, 0.5)}, ()),
        (None, {A: IN, B: ALSO_IN}, ()),
        (None, {A: IN, B: ALSO_IN, STONE: (EDGE + 0.9 * MARGIN, 0.5)}, ()),
        ("intruder inside", {A: IN, B: ALSO_IN, STONE: (EDGE + 1.1 * MARGIN, 0.5)}, ()),
        ("part undone", {A: IN, B: (-0.5, -0.2), STONE: (0.6, 0.4)}, ()),
    ],
)
def test_a_state_has_the_first_kind_that_fits(kind, places, touched):
    found = int(_kind(*_state(places, touched)))
    assert (None if found == UNCLEAR else KINDS[found]) == kind


def test_two_of_three_missing_are_another_kind():
    three = shoes(1, 2, 3)
    assert KINDS[int(kind_of(three, start(), *_state({A: IN})))] == "other"


@pytest.mark.parametrize(("inside", "clear"), [(1.1, True), (0.9, False), (-0.1, False)])
def test_a_clear_success_stays_one_when_an_object_is_shifted(inside, clear):
    shoe, stone = one_shoe(), (EDGE - inside * MARGIN, 0.3)
    center, _ = _state({A: (EDGE + inside * MARGIN, 0.5)})
    assert bool(is_clear_success(shoe, start(), center)) is clear
    center, _ = _state({A: IN, STONE: stone})
    assert bool(is_clear_success(shoe, start(), center)) is clear


def test_the_margin_is_two_pixels_of_a_small_picture():
    np.testing.assert_allclose(margin(TWO), 2 * (2 * TWO.half_extent) / 96)
    np.testing.assert_allclose(margin(TWO), MARGIN)
