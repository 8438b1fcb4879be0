"""States of a scene with its things elsewhere, and how a reward ranks them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.audit.elsewhere import Start, arrangements, possible, ranked

ARENA = 0.9
# A robot, a region, four blocks of two colours and two shapes, and a slot without one.
CENTER = [[0.5, 0.5], [-0.4, 0.4], [0.7, -0.7], [-0.7, -0.7], [0.1, -0.2], [0.0, 0.6], [2.0, 0.0]]
SIZE = [[0.2, 0.2], [0.6, 0.5], *[[0.2, 0.2]] * 4, [0.0, 0.0]]
KIND = [[9, 9], [0, 9], [0, 0], [0, 1], [1, 0], [1, 1], [0, 0]]
START = Start(jnp.array(CENTER), jnp.array(SIZE), jnp.array(KIND), 1, ARENA)
BLOCKS = slice(2, 6)


@pytest.fixture(scope="module")
def states():
    made = jax.jit(lambda key: arrangements(key, START, 600))(jax.random.key(0))
    return np.asarray(made)


def test_regions_and_what_is_not_there_stay_and_all_else_moves_within_the_walls(states):
    np.testing.assert_array_equal(
        states[:, [1, 6]], np.asarray(START.center)[None, [1, 6]].repeat(600, 0)
    )
    gone = np.abs(states - CENTER).max(axis=-1) > 1e-6
    assert 0.5 < gone[:, [0, 2, 3, 4, 5]].mean() < 0.9
    assert np.abs(states[:, [0, 2, 3, 4, 5]]).max() <= ARENA - 0.1 + 1e-6
    assert 0.3 < gone[:, [0, 2, 3, 4, 5]].all(axis=1).mean() < 0.6  # those that move whole


def test_blocks_come_together_by_either_kind_in_a_region_and_on_a_line(states):
    blocks = states[:, BLOCKS]
    apart = np.abs(blocks[:, :, None] - blocks[:, None]).max(axis=-1)
    near = apart < 2 * 0.28 * ARENA + 1e-6
    for one, two in (([0, 1], [2, 3]), ([0, 2], [1, 3])):  # by colour, by shape
        heaps = near[:, one[0], one[1]] & near[:, two[0], two[1]] & ~near[:, one[0], two[0]]
        assert heaps.mean() > 0.05
    inside = (np.abs(blocks - CENTER[1]) < np.array(SIZE[1]) / 2).all(axis=(1, 2))
    assert inside.mean() > 0.03
    middle = blocks - blocks.mean(axis=1, keepdims=True)
    assert (np.linalg.svd(middle, compute_uv=False)[:, 1] < 1e-5).mean() > 0.03


def test_a_scene_without_regions_or_without_blocks_has_states_too():
    plain = START._replace(regions=0, center=START.center[:1], size=START.size[:1])
    made = arrangements(jax.random.key(1), plain._replace(kind=START.kind[:1]), 20)
    assert np.isfinite(made).all()
    assert np.ptp(np.asarray(made), axis=0).max() > 0.5


@pytest.mark.parametrize(
    ("index", "place", "wanted"),
    [
        (2, CENTER[2], True),
        (2, [-0.6, -0.65], False),  # in another block
        (2, [-0.49, -0.7], True),  # beside it
        (2, CENTER[1], True),  # in the region
        (0, CENTER[3], True),  # a robot may hold one
        (6, CENTER[3], True),  # what is not there takes no place
    ],
)
def test_no_block_may_lie_in_another(index, place, wanted):
    center = START.center.at[index].set(jnp.array(place))
    assert bool(possible(center, START)) is wanted


def _loops(reward, success, counted):
    """The same figures in plain loops."""
    known = [i for i in range(len(reward)) if counted[i]]
    good, bad = ([i for i in known if success[i] == what] for what in (True, False))
    if not good or not bad:
        return np.nan, np.nan
    above = [(reward[i] > reward[j]) + 0.5 * (reward[i] == reward[j]) for i in good for j in bad]
    return np.mean(above), float(success[max(known, key=lambda i: reward[i])])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_figures_are_those_of_plain_loops(share):
    rng = np.random.default_rng(0)
    for _ in range(20):
        reward = rng.integers(0, 6, 12).astype(np.float32)  # with ties
        reward += 0.01 * (np.arange(12) == reward.argmax())  # but one state has most
        success, counted = rng.random(12) < share, rng.random(12) < 0.8
        with jax.debug_nans(False):
            ours = ranked(*map(jnp.asarray, (reward, success, counted)))
        reward[~counted] -= 100.0
        np.testing.assert_allclose(ours, _loops(reward, success, counted), rtol=1e-6)
