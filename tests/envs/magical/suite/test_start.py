"""Starts of MAGICAL's tasks: the Demo layouts' figures, and what each variant may draw.

Figures of the Demo layouts were measured in the original; polygons are told apart by axes that
separate them, which is another test than the one that places them.
"""

import functools
import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.magical.suite import places
from gril_jax.envs.magical.suite.plan import VARIANTS
from gril_jax.envs.planar import shapes as block_shapes
from gril_jax.envs.planar.shapes import NOTHING, SHAPES
from support import planar_scenes

from gril_jax import envs

TASKS = (
    "move_to_corner", "move_to_region", "find_dupe", "fix_colour", "cluster_colour",
    "cluster_shape", "make_line",
)  # fmt: skip
LENGTHS = dict(zip(TASKS, (80, 40, 100, 60, 240, 240, 180), strict=True))
LACKS = {"move_to_corner": {"layout", "countplus"}, "move_to_region": {"shape", "countplus"}}
MANY = 48


@functools.cache
def _task(name, variant="demo"):
    return envs.make(name, variant=variant, engine="impulse")


@functools.cache
def _starts(name, variant, count=MANY):
    keys = jax.random.split(jax.random.key(1), count)
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(_task(name, variant).reset))(keys))


@functools.cache
def _kinds(name, variant, count=600):
    """What a variant draws without its places."""
    env = _task(name, variant)

    def draw(key):
        numbers = itertools.count()
        return env.draw(lambda: jax.random.fold_in(key, next(numbers)), env._kinds)

    drawn = jax.vmap(draw)(jax.random.split(jax.random.key(2), count))
    return jax.tree.map(np.asarray, drawn)


# ---------------------------------------------------------------- the Demo layouts


@pytest.fixture(scope="module")
def demo():
    return {name: _starts(name, "demo", 2) for name in TASKS}


@pytest.mark.parametrize("name", TASKS)
def test_lengths_and_variants_are_the_originals(name):
    assert _task(name).episode_length == LENGTHS[name]
    assert {*_task(name).variants} == {*VARIANTS} - LACKS.get(name, set())
    for variant in LACKS.get(name, ()):
        with pytest.raises(ValueError, match=f"variant is '{variant}', but must be"):
            envs.make(name, variant=variant)


def test_there_are_eight_demo_and_52_test_variants():
    """MatchRegions' are eight, too."""
    assert sum(len(_task(name).variants) - 1 for name in TASKS) + 7 == 52


def _away(pose, point):
    return math.dist(pose[:2], point)


def test_demo_starts_have_the_distances_that_were_measured_in_the_original(demo):
    pose = {name: state.data.pose[0, 3:] for name, state in demo.items()}
    assert _away(pose["move_to_corner"][0], (-1, 1)) == pytest.approx(1.983, abs=5e-4)
    region = {name: state.data.regions[0] for name, state in demo.items()}
    place = demo["move_to_region"].data.pose[0, 0]
    assert _away(place, region["move_to_region"][0, :2]) == pytest.approx(1.122, abs=5e-4)
    dupe = _away(pose["find_dupe"][5], region["find_dupe"][0, :2])
    assert dupe == pytest.approx(1.21, abs=5e-3)
    odd, box = pose["fix_colour"][2], region["fix_colour"][2]
    right, top = box[:2] + box[2:] / 2 - odd[:2]
    left, bottom = odd[:2] - (box[:2] - box[2:] / 2)
    found = [right, top, bottom, left]
    np.testing.assert_allclose(found, [0.073, 0.196, 0.302, 0.345], atol=1e-5)


@pytest.mark.parametrize(
    ("name", "centres"),
    [("move_to_region", [(-0.245, -0.55)]), ("find_dupe", [(-0.36, -0.555)]),
     ("fix_colour", [(0.202, 0.1345), (0.248, -0.621), (-0.472, -0.053)])],
)  # fmt: skip
def test_regions_have_the_original_s_middles(demo, name, centres):
    np.testing.assert_allclose(demo[name].data.regions[0, :, :2], centres, atol=1e-6)


def test_the_clusters_begin_with_four_and_five_right_blocks(demo):
    from gril_jax.envs.magical.suite.together import right

    for name, wanted in (("cluster_colour", 4), ("cluster_shape", 5)):
        data, env = jax.tree.map(lambda f: f[0], demo[name].data), _task(name)
        kind = env.kind(jnp.asarray(data.shape), jnp.asarray(data.colour))
        good = right(jnp.asarray(data.pose[3:, :2]), kind, jnp.ones(8, bool))
        assert int(good.sum()) == wanted
        classes = sorted(np.bincount(kind).tolist(), reverse=True)
        assert classes == [3, 2, 2, 1]


def test_demo_starts_score_nothing_and_are_one(demo):
    for name in TASKS:
        assert (demo[name].metrics["score"] == 0).all()
        for leaf in jax.tree.leaves(demo[name]):
            np.testing.assert_array_equal(*leaf)


# ---------------------------------------------------------------- places


def _corners(shape, pose):
    """Corners of a star's hull, or of a polygon, and by how much they are rounded."""
    made = block_shapes._TABLE[SHAPES[shape]]
    points = np.unique(np.stack([made.corners.x, made.corners.y], axis=1).round(7), axis=0)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return points @ np.array([[c, s], [-s, c]]) + pose[:2], made.radius


def _robot(env, pose):
    """The convex parts of the robot: its disc, and the boxes of its fingers."""
    yield pose[:1, :2], 0.2
    for part, (x, y, angle) in zip(env.robot.parts[1:], pose[1:3], strict=True):
        for box in part.boxes:
            corners = box.half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            corners = planar_scenes.turned(corners, box.angle) + box.center
            yield planar_scenes.turned(corners, angle) + [x, y], 0.0


def _apart(one, other):
    """True if an axis separates two convex bodies, each points and a radius about them."""
    angles = np.linspace(0, np.pi, 720, endpoint=False)
    axes = np.stack([np.cos(angles), np.sin(angles)])
    (low_a, high_a), (low_b, high_b) = (
        ((points @ axes).min(axis=0) - r, (points @ axes).max(axis=0) + r)
        for points, r in (one, other)
    )
    return bool(((low_a > high_b) | (low_b > high_a)).any())


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("variant", [pytest.param("jitter", marks=pytest.mark.slow), "all"])
def test_starts_are_free_of_overlap(name, variant):
    state, env = _starts(name, variant), _task(name, variant)
    data, homes = state.data, {b: block.home for b, block in enumerate(env.plan.blocks)}
    assert not state.metrics["unplaced"].any()
    for m in range(8):
        there = np.flatnonzero(data.shape[m] != NOTHING)
        bodies = {b: _corners(data.shape[m, b], data.pose[m, 3 + b]) for b in there}
        for a, b in itertools.combinations(there, 2):
            if {data.shape[m, a], data.shape[m, b]} != {SHAPES.index("star")}:
                assert _apart(bodies[a], bodies[b]), (m, a, b)
        boxes = [
            (box[:2] - box[2:] / 2, box[:2] + box[2:] / 2) for box in data.regions[m] if box[2] > 0
        ]
        for r, (low, high) in enumerate(boxes):
            square = np.array([low, (low[0], high[1]), high, (high[0], low[1])])
            for b in there:
                place = data.pose[m, 3 + b, :2]
                at_home = homes.get(b) == r and (low <= place).all() and (place <= high).all()
                assert at_home or _apart(bodies[b], (square, 0.0))
            assert (low > -1).all()
            assert (high < 1).all()
            assert all(_apart(part, (square, 0.0)) for part in _robot(env, data.pose[m]))
        for part in _robot(env, data.pose[m]):
            assert np.abs(part[0]).max() + part[1] < 1
            assert all(_apart(part, body) for body in bodies.values())


@pytest.mark.parametrize("name", TASKS)
def test_jitter_keeps_to_its_ranges(name):
    data, env = _starts(name, "jitter").data, _task(name)
    known = places.demo(env.plan, len(env.plan.blocks))
    most = np.array([0.025, 0.025, 0.05 * math.pi]) + 1e-6
    assert (np.abs(data.pose[:, 0] - known.robot) <= most).all()
    side = np.abs(data.regions[..., 2:] - known.regions[:, 2:])
    assert (side <= 0.0075 + 1e-6).all()
    for b, block in enumerate(env.plan.blocks):
        if block.home is None:
            aim = np.asarray(known.blocks[b])
        else:  # about the middle of its region, wherever it is in Demo
            middle = data.regions[:, block.home, :2]
            aim = np.concatenate([middle, np.full((MANY, 1), block.pose[2])], axis=1)
        off = np.abs(data.pose[:, 3 + b] - aim)
        assert (off <= most).all()
        assert off[:, :2].max() > 0.02
        assert off[:, 2].max() > 0.12
    moved = np.abs(data.regions[..., :2] - known.regions[:, :2])
    assert moved.max(initial=0) <= 0.025 + 0.00375 + 1e-6


def _anywhere(values, limit):
    """True if numbers reach both ends of what is allowed."""
    return (
        values.min() < -0.55 * limit and values.max() > 0.55 * limit and abs(values).max() <= limit
    )


@pytest.mark.parametrize("name", [name for name in TASKS if name != "move_to_corner"])
def test_all_puts_things_anywhere(name):
    data, env = _starts(name, "all").data, _task(name, "all")
    there = data.shape != NOTHING
    pose = data.pose[:, 3 : 3 + there.shape[1]][there]
    for numbers in (data.pose[:, 0], *([pose] if len(pose) else [])):
        assert _anywhere(numbers[:, 2], math.pi)
    if len(pose):
        assert _anywhere(pose[:, 0], 1.0)
        assert _anywhere(pose[:, 1], 1.0)
    sides = data.regions[..., 2:][data.regions[..., 2] > 0]
    if len(sides):
        low, high = env.plan.sides
        assert low <= sides.min() < low + 0.02
        assert high - 0.02 < sides.max() <= high


@pytest.mark.parametrize(("name", "margin"), [("find_dupe", 0.06), ("fix_colour", 0.12)])
def test_blocks_at_home_keep_a_margin_from_the_edge(name, margin):
    data, env = _starts(name, "all").data, _task(name, "all")
    for b, block in enumerate(env.plan.blocks):
        if block.home is None:
            continue
        there = data.shape[:, b] != NOTHING
        box = data.regions[there, block.home]
        off = np.abs(data.pose[there, 3 + b, :2] - box[:, :2]).max(axis=1)
        room = box[:, 2:].min(axis=1) / 2 - margin
        assert (off <= room + 1e-6).all()
        assert (off / room).max() > 0.9


def test_the_corner_s_all_has_no_places_but_jitter():
    data = _starts("move_to_corner", "all").data
    known = places.demo(_task("move_to_corner").plan, 1)
    assert np.abs(data.pose[:, 3, :2] - known.blocks[0, :2]).max() <= 0.025 + 1e-6
    assert len(set(data.colour[:, 0])) == len(set(data.shape[:, 0])) == 4


def test_dynamics_are_drawn_in_magical_s_ranges():
    state = _starts("move_to_region", "all")
    ranges = np.array([(2.2, 3.5), (0.7, 1.5), (2.5, 4.5), (1.0, 1.8), (0.07, 0.15)])
    share = (state.data.strengths - ranges[:, 0]) / (ranges[:, 1] - ranges[:, 0])
    assert -1e-5 <= share.min() < 0.05
    assert 0.95 < share.max() <= 1 + 1e-5
    fixed = _starts("move_to_region", "demo", 2).data.strengths
    np.testing.assert_allclose(fixed, 2 * [[3.0, 1.0, 4.0, 1.5, 0.1]])


def test_more_than_fits_is_flagged():
    env = _task("cluster_colour", "layout")
    draw = functools.partial(places.draw, plan=env.plan, kinds=env._kinds, robot=env.robot)
    start = jax.jit(functools.partial(draw, arena=0.55, anywhere=True))(jax.random.key(0))
    assert start.unplaced
    assert np.isfinite(start.blocks).all()


# ---------------------------------------------------------------- colours, shapes, counts


def _uniform(values, count=4):
    np.testing.assert_allclose(
        np.bincount(values.ravel(), minlength=count) / values.size, 1 / count, atol=0.09
    )


def test_find_dupe_draws_a_query_and_its_duplicate_follows():
    colour, shape, both = (_kinds("find_dupe", v) for v in ("color", "shape", "countplus"))
    demo = _task("find_dupe")._kinds
    for drawn in (colour, both):
        assert (drawn.colour[:, 5] == drawn.colour[:, 6]).all()
        assert (drawn.region_colour[:, 0] == drawn.colour[:, 6]).all()
        for b in range(6):
            _uniform(drawn.colour[:, b])
    for drawn in (shape, both):
        assert (drawn.shape[:, 5] == drawn.shape[:, 6]).all()
        _uniform(drawn.shape[:, 6])
    assert (colour.shape == demo.shape).all()
    assert (shape.colour == demo.colour).all()
    count = (both.shape[:, :5] != NOTHING).sum(axis=1)
    np.testing.assert_allclose(np.bincount(count, minlength=6)[1:] / 600, 0.2, atol=0.06)
    twin = (shape.shape[:, 3] == shape.shape[:, 6]).mean()  # it has the query's colour
    assert twin == pytest.approx(0.25, abs=0.06)


def test_fix_colour_has_one_odd_block_with_skewed_colours():
    drawn, counted = _kinds("fix_colour", "color", 3000), _kinds("fix_colour", "countplus", 3000)
    odd = drawn.colour != drawn.region_colour
    assert (odd.sum(axis=1) == 1).all()
    _uniform(odd.argmax(axis=1), 3)
    _uniform(drawn.region_colour)
    red, green, blue, yellow = (COLOURS.index(c) for c in ("red", "green", "blue", "yellow"))
    third = {red: 1 / 3, green: 1 / 3, blue: 1 / 3}
    wanted = {
        red: {green: 2 / 3, blue: 1 / 3}, green: {red: 1 / 3, blue: 2 / 3},
        blue: {red: 1 / 3, green: 1 / 3, yellow: 1 / 3}, yellow: third,
    }  # fmt: skip
    for region, shares in wanted.items():
        found = drawn.colour[odd & (drawn.region_colour == region)]
        for colour in range(4):
            assert (found == colour).mean() == pytest.approx(shares.get(colour, 0), abs=0.07)
    two = ~counted.region_there[:, 2]
    assert two.mean() == pytest.approx(0.5, abs=0.04)
    assert (counted.shape[two, 2] == NOTHING).all()
    odd = (counted.colour != counted.region_colour) & counted.region_there
    assert (odd.sum(axis=1) == 1).all()  # and is one of those that are there


@pytest.mark.parametrize("name", ["cluster_colour", "cluster_shape"])
def test_clusters_have_each_class_at_least_once(name):
    for variant, fixed in (("color", "shape"), ("shape", "color"), ("countplus", None)):
        drawn = _kinds(name, variant)
        there = drawn.shape != NOTHING
        for what, values in (("color", drawn.colour), ("shape", drawn.shape)):
            if what == fixed:
                continue
            counts = np.stack([((values == k) & there).sum(axis=1) for k in range(4)], axis=1)
            assert counts.min() == 1
            assert counts.max() <= 7
            _uniform(values[:, 0])  # in any order
    count = there.sum(axis=1)
    assert {*count} == {7, 8, 9, 10}
    np.testing.assert_allclose(np.bincount(count)[7:] / 600, 0.25, atol=0.07)


def test_match_regions_draws_one_or_two_targets_and_up_to_two_of_each_other_colour():
    drawn = _kinds("match_regions_magical", "all")
    there, original = drawn.shape != NOTHING, ("red", "green", "blue", "yellow")
    assert (drawn.colour[:, :2] == drawn.region_colour).all()
    for colour, shown, region in zip(drawn.colour, there, drawn.region_colour[:, 0], strict=True):
        others = [COLOURS.index(name) for name in original if COLOURS.index(name) != region]
        for k, other in enumerate(others):  # groups take the other colours in the original's order
            assert (colour == other).nonzero()[0].tolist() == [[5, 6], [2, 7], [3, 4]][k]
        assert shown[0]
        assert sum(shown[colour == region]) in (1, 2)
    number = np.bincount(there[:, 2:].sum(axis=1), minlength=7) / len(there)
    np.testing.assert_allclose(number, np.array([1, 3, 6, 7, 6, 3, 1]) / 27, atol=0.06)
    np.testing.assert_allclose(np.bincount(drawn.region_colour[:, 0]) / len(there), 0.25, atol=0.06)
    only = _kinds("match_regions_magical", "color")
    assert (only.shape == _task("match_regions_magical")._kinds.shape).all()


def test_lines_have_three_or_four_blocks_of_any_kind():
    drawn = _kinds("make_line", "countplus")
    count = (drawn.shape != NOTHING).sum(axis=1)
    assert {*count} == {3, 4}
    assert (count == 3).mean() == pytest.approx(0.5, abs=0.08)
    _uniform(drawn.colour)
    _uniform(drawn.shape[:, :3])


def test_layout_and_jitter_keep_the_kinds_and_dynamics_keeps_all():
    for name in ("find_dupe", "make_line"):
        demo, moved = _task(name)._kinds, _kinds(name, "layout")
        assert (moved.colour == demo.colour).all()
        assert (moved.shape == demo.shape).all()
    state, still = (_starts("make_line", variant, 2) for variant in ("dynamics", "demo"))
    np.testing.assert_array_equal(state.data.pose, still.data.pose)
    assert not np.allclose(state.data.strengths, still.data.strengths)
