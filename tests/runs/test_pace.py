"""The length of calls: one move first, then as many as fit into a few seconds."""

import pytest

from gril_jax.runs import pace


def test_the_first_call_is_one_move_and_the_next_ones_last_a_few_seconds():
    found = pace.Pace()
    assert found.moves(50) == 1
    for moves, seconds, after in ((1, 1.0, 4), (4, 2.0, 8), (8, 8.0, 4), (4, 1e-9, 50)):
        found.took(moves, seconds)
        assert found.moves(50) == after


@pytest.mark.parametrize("seconds", [20.0, 1e9])
def test_a_move_that_takes_longer_than_a_call_is_made_alone(seconds):
    found = pace.Pace()
    found.took(1, seconds)
    assert found.moves(10) == 1
