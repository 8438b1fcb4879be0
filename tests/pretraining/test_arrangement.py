"""Common properties of ends, found in made-up demonstrations whose rule is known."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.pretraining import batch, contrast
from gril_jax.pretraining.arrangement import Arrangement, arrangement, disarray, words_of
from gril_jax.pretraining.options import Hyper, Static
from gril_jax.types import DemoBatch

CLASSES = ("robot", "red region", "red star", "blue star", "blue square")
WORDS = words_of(CLASSES)
LABEL = jnp.array([0, 1, 2, 3, 4, 3])  # a robot, a region, and four blocks, of which two are twins
SIZE = jnp.array([[0.4, 0.4], [0.6, 0.6]] + [[0.2, 0.2]] * 4)
BLOCKS = slice(2, 6)
DEMOS = 12


def _demos(ends, region=(3.0, 3.0), begins=None) -> DemoBatch:
    """Demonstrations of two frames; `ends` and `begins` are the blocks' places, (B, 4, 2)."""
    drawn = np.random.default_rng(0)
    if begins is None:
        begins = np.array([[-0.8, 0.8], [0.8, 0.8], [0.8, -0.7], [-0.1, 0.8]])
        begins = begins + drawn.uniform(-0.02, 0.02, ends.shape)
    rest = np.broadcast_to([[0.0, 0.0], region], (len(ends), 2, 2))
    frames = [np.concatenate([rest, blocks], axis=1) for blocks in (begins, ends)]
    center = jnp.asarray(np.stack(frames, axis=1), jnp.float32)
    num = len(ends)
    return DemoBatch(
        center, jnp.broadcast_to(SIZE, (num, 2, 6, 2)), jnp.tile(LABEL, (num, 1)),
        jnp.tile(LABEL == 0, (num, 1)), jnp.ones((num, 6), bool), jnp.full(num, 2),
    )  # fmt: skip


def _line(seed=1):
    """Four blocks on a line, 0.25 apart, in any order, anywhere and at any angle."""
    drawn = np.random.default_rng(seed)
    angle = drawn.uniform(0, np.pi, DEMOS)
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    steps = np.stack([drawn.permutation(4) for _ in range(DEMOS)]) - 1.5
    return drawn.uniform(-0.4, 0.4, (DEMOS, 1, 2)) + 0.25 * steps[..., None] * way[:, None]


def _inside(seed=1):
    """The red star in the region, all others where they were."""
    drawn = np.random.default_rng(seed)
    ends = np.array(_demos(_line()).center[:, 0, BLOCKS])
    ends[:, 0] = [-0.5, -0.5] + drawn.uniform(-0.15, 0.15, (DEMOS, 2))
    return ends


FOUND = jax.jit(lambda demos: arrangement(demos, WORDS))
KNOWN = {"inside": _demos(_inside(), (-0.5, -0.5)), "line": _demos(_line())}


@functools.cache
def _goal(name) -> Arrangement:
    return FOUND(KNOWN[name])


@jax.jit
def _lacks(goal, center, active=None):
    active = goal.moves[LABEL] if active is None else active
    return disarray(goal, center, SIZE, LABEL, LABEL != 0, active, near_cost_fraction=0.7)


def _of(goal, blocks):
    name = "inside" if goal.bonds.inside.any() else "line"
    return float(_lacks(goal, jnp.concatenate([KNOWN[name].center[0, 0, :2], blocks])))


def test_words():
    assert WORDS == ((0, 0), (1, 2), (1, 3), (4, 3), (4, 5))


@pytest.mark.parametrize("name", KNOWN)
def test_ends_lack_nothing_and_beginnings_a_whole(name):
    each = jax.jit(jax.vmap(lambda goal, center: _lacks(goal, center), (None, 0)))
    begin, end = (np.asarray(each(_goal(name), KNOWN[name].center[:, t])) for t in (0, 1))
    assert end.mean() < 0.05
    assert begin.mean() == pytest.approx(1.0, abs=0.3)
    assert end.max() < 0.3 * begin.min()


def test_a_region_holds_what_all_ends_have_in_it_and_keeps_out_the_others():
    goal = _goal("inside")
    assert np.flatnonzero(goal.bonds.container).tolist() == [1]
    assert np.argwhere(goal.bonds.inside).tolist() == [[2, 1]]
    assert np.argwhere(goal.bonds.outside).tolist() == [[3, 1], [4, 1]]
    assert not goal.distances.weight.any()  # what belongs in the region has no distances
    ends = KNOWN["inside"].center[0, 1, BLOCKS]
    done, intruded = _of(goal, ends), _of(goal, ends.at[1].set(jnp.array([-0.4, -0.6])))
    undone = _of(goal, ends.at[0].set(jnp.array([0.3, 0.3])))
    assert done < 0.1 < intruded
    assert done < 0.1 < 0.6 < undone


def test_a_line_counts_in_any_order_place_and_angle_and_a_clump_does_not():
    goal = _goal("line")
    assert (np.asarray(goal.distances.weight) > 0).any()
    assert not goal.placed.any()
    assert not goal.bonds.inside.any()
    new = jnp.asarray(_line(seed=7)[0], jnp.float32)
    mirrored = new[::-1] * jnp.array([-1.0, 1.0])
    clump = jnp.array([[0.0, 0.0], [0.25, 0.0], [0.0, 0.25], [0.25, 0.25]])
    assert _of(goal, new) < 0.05
    assert _of(goal, mirrored) < 0.05
    assert _of(goal, clump) > 0.1


def test_where_two_regions_of_a_class_hold_something_none_may_be_empty():
    """A robot, two red regions, and two stars, of which the first one goes into a region."""
    label = jnp.array([0, 1, 1, 2, 2])
    size = jnp.array([[0.4, 0.4], [0.6, 0.6], [0.6, 0.6], [0.2, 0.2], [0.2, 0.2]])
    rest = [[0.0, 0.8], [-0.5, -0.5], [0.5, -0.5]]
    drawn = np.random.default_rng(4).uniform(-0.1, 0.1, (DEMOS, 2, 2))
    begin = [np.array([*rest, [0.5, 0.5], [-0.5, -0.5] + d[1]]) for d in drawn]
    end = [np.array([*rest, [0.5, -0.5] + d[0], [-0.5, -0.5] + d[1]]) for d in drawn]
    many = lambda x: jnp.broadcast_to(x, (DEMOS, *x.shape))  # noqa: E731
    demos = DemoBatch(
        jnp.asarray(np.stack([begin, end], axis=1), jnp.float32), many(jnp.stack([size, size])),
        many(label), many(label == 0), many(jnp.ones(5, bool)), jnp.full(DEMOS, 2),
    )  # fmt: skip
    goal = FOUND(demos)
    assert np.flatnonzero(goal.bonds.filled).tolist() == [1]
    lack = lambda center: float(  # noqa: E731
        jax.jit(lambda c: disarray(goal, c, size, label, label != 0, label == 2))(center)
    )
    done = demos.center[0, 1]
    both_in_one = done.at[3].set(jnp.array([-0.4, -0.4]))
    assert lack(done) < 0.1 < 0.3 < lack(both_in_one)
    assert not _goal("inside").bonds.filled.any()  # a single region is filled by what belongs in it


def test_what_no_demonstration_moves_costs_once_it_has_been_moved():
    goal = _goal("inside")
    assert np.flatnonzero(goal.rests).tolist() == [3, 4]
    end, moved = KNOWN["inside"].center[0, 1], jnp.arange(6) == 2
    cost = lambda also: float(_lacks(goal, end, moved | (jnp.arange(6) == also)))  # noqa: E731
    assert cost(4) == pytest.approx(cost(2) + 0.1, abs=1e-5)
    assert float(_lacks(goal, end, jnp.ones(6, bool))) == pytest.approx(cost(2) + 0.2, abs=1e-5)


def test_twins_may_change_places():
    goal, blocks = _goal("line"), jax.random.uniform(jax.random.key(0), (4, 2))
    assert _of(goal, blocks[jnp.array([0, 3, 2, 1])]) == pytest.approx(_of(goal, blocks), abs=1e-5)


def test_a_place_in_the_arena_counts_where_all_ends_are_near():
    drawn = np.random.default_rng(3)
    ends = np.array(KNOWN["line"].center[:, 0, BLOCKS])
    ends[:, 2] = [-0.8, 0.0] + drawn.uniform(-0.05, 0.05, (DEMOS, 2))
    goal = FOUND(_demos(ends))
    assert np.flatnonzero(goal.placed).tolist() == [4]
    away = jnp.asarray(ends[0], jnp.float32).at[2].set(jnp.array([0.0, 0.0]))
    assert _of(goal, jnp.asarray(ends[0], jnp.float32)) < 0.1 < 0.5 < _of(goal, away)


def test_costs_are_bounded_and_have_finite_slopes():
    goal = _goal("line")
    same = jnp.zeros((6, 2))  # all objects in one point
    value, slope = jax.jit(jax.value_and_grad(lambda c: _lacks(goal, c)))(same)
    assert 0.0 <= float(value) <= 2.0
    assert np.isfinite(slope).all()


def test_what_moves_as_one_keeps_its_distances():
    center = KNOWN["line"].center[0, 1]
    moving = jnp.arange(6) >= 2
    chosen, there = jax.jit(jax.vmap(lambda key: batch._as_one(key, center, moving, 1.0)))(
        jax.random.split(jax.random.key(0), 64)
    )
    some = np.asarray(chosen.any(axis=1))
    assert 0 < some.sum() < 64
    apart = lambda x: jnp.linalg.norm(x[..., :, None, :] - x[..., None, :, :], axis=-1)  # noqa: E731
    wanted = np.asarray(apart(center[BLOCKS]))
    for moved in np.asarray(apart(there[:, BLOCKS]))[some]:
        np.testing.assert_allclose(moved, wanted, atol=1e-4)
    assert np.abs(np.asarray(there)[some][:, BLOCKS]).max() <= 1.0 + 1e-5
    assert (np.asarray(there)[:, :2] == np.asarray(center[:2])).all()


@pytest.fixture(scope="module")
def other_layouts():
    """Copies of an end, in which the robot stands and only the star in the region has moved."""
    demo = jax.tree.map(lambda x: x[0], KNOWN["inside"])
    moved, goal = jnp.arange(6) == 2, _goal("inside")
    draw = lambda key: batch.displaced(  # noqa: E731
        key, demo.center[1], SIZE, moved, demo, goal, 1.0
    )
    keys = jax.random.split(jax.random.key(0), 500)
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(draw))(keys)), np.asarray(demo.center[1])


def test_some_copies_show_another_layout_in_which_nothing_has_moved(other_layouts):
    made, center = other_layouts
    elsewhere = (np.abs(made.center - center) > 0.05).any(axis=2)
    for block in (3, 4, 5):
        bits = made.active[elsewhere[:, block], block]
        assert 0.3 < bits.mean() < 0.9
    # A region is never moved, wherever it lies: its bit is set as seldom as a touched thing's.
    assert made.active[elsewhere[:, 1], 1].mean() < 0.4
    assert elsewhere[:, 1].mean() > 0.2
    assert not elsewhere[:, 0].any()


def test_in_another_layout_the_region_has_another_size_and_takes_along_what_lies_in_it(
    other_layouts,
):
    made, center = other_layouts
    factor = made.size / np.asarray(SIZE)
    assert (factor[:, [0, 2, 3, 4, 5]] == 1).all()
    assert 0.7 <= factor[:, 1].min() < 0.8 < 1.4 < factor[:, 1].max() <= 1.5
    far = (np.abs(made.center[:, 1] - center[1]) > 0.3).any(axis=1)
    inside = (np.abs(made.center[:, 2] - made.center[:, 1]) <= made.size[:, 1] / 2).all(axis=1)
    assert 0.2 < inside[far].mean() < 0.9


def test_some_copies_hold_other_things_where_no_demonstration_moves_any():
    demo, goal = jax.tree.map(lambda x: x[0], KNOWN["inside"]), _goal("inside")
    draw = jax.jit(jax.vmap(lambda key: batch.other_things(key, demo, goal)))
    label, there = map(np.asarray, draw(jax.random.split(jax.random.key(0), 400)))
    own = np.asarray(demo.label)
    rests = np.asarray(goal.rests)[own] & ~np.asarray(demo.is_robot)
    assert rests.any()
    assert (label == own)[:, ~rests].all()
    assert there[:, ~rests].all()
    assert 0.15 < 1 - there[:, rests].mean() < 0.35  # half of the copies, half of their things
    assert 0.4 < there.all(axis=1).mean() < 0.8
    assert 0.02 < (label != own)[:, rests].mean() < 0.15
    assert set(label.ravel()) <= set(own)


def test_the_loss_learns_from_copies_that_hold_other_things(monkeypatch):
    demos, goal = KNOWN["inside"], _goal("inside")
    config = Static(
        EncoderConfig(5, width=4, rounds=1, latent=3), goal_model="arrangement", words=WORDS,
        num_perturbations=3, perturbed_frames=4,
    )  # fmt: skip
    params = encoder.init(jax.random.key(0), config.encoder)

    def loss():
        bits = jnp.zeros(demos.center.shape[:3], bool)
        key = jax.random.key(1)
        once = jax.jit(lambda p: contrast.contrast(p, key, demos, bits, goal, Hyper(), config))
        return float(once(params))

    found = loss()
    monkeypatch.setattr(
        contrast, "other_things", lambda key, demo, ends: (demo.label, demo.present)
    )
    assert np.isfinite(found)
    assert found != loss()
