"""Scores of MAGICAL's tasks against their formulas as loops in NumPy, and at edges."""

import functools
import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.layout import COLOURS
from gril_jax.envs.magical.suite.plan import Scene
from gril_jax.envs.planar.shapes import NOTHING, SHAPES

from gril_jax import envs

MANY = 400
TASKS = {
    "move_to_corner": 1, "move_to_region": 0, "find_dupe": 7, "fix_colour": 3, "cluster_colour": 10,
    "cluster_shape": 10, "make_line": 4, "match_regions_magical": 8,
}  # fmt: skip
REGIONS = {"move_to_region": 1, "find_dupe": 1, "fix_colour": 3, "match_regions_magical": 1}


# ---------------------------------------------------------------- the formulas as loops


def _inside(box, p):
    return bool(abs(p[0] - box[0]) <= box[2] / 2 and abs(p[1] - box[1]) <= box[3] / 2)


def _move_to_corner(s):
    d = math.dist(s.blocks[0], (-1, 1))
    return min(1.0, max(0.0, math.sqrt(2) - d) / (math.sqrt(2) - math.sqrt(2) / 2))


def _move_to_region(s):
    return float(_inside(s.regions[0], s.robot))


def _find_dupe(s):
    there = [b for b in range(7) if s.shape[b] != NOTHING]
    look = [(int(s.colour[b]), int(s.shape[b])) for b in range(7)]
    within = [look[b] == look[6] for b in there if _inside(s.regions[0], s.blocks[b])]
    n_t, n_d = within.count(True), within.count(False)
    return 1 - n_d / (n_t + n_d) if n_t >= 2 else 0.0


def _fix_colour(s):
    there = [b for b in range(3) if s.shape[b] != NOTHING]
    for r in there:
        found = {b for b in there if _inside(s.regions[r], s.blocks[b])}
        if found != ({r} if s.colour[r] == s.region_colour[r] else set()):
            return 0.0
    return 1.0


def _cluster(s, kinds):
    there = [b for b in range(len(s.shape)) if s.shape[b] != NOTHING]
    classes = {int(kinds[b]) for b in there}
    mean = {k: np.mean([s.blocks[b] for b in there if kinds[b] == k], axis=0) for k in classes}
    right = 0
    for b in there:
        a = math.dist(s.blocks[b], mean[int(kinds[b])])
        far = min((math.dist(s.blocks[b], mean[k]) for k in classes - {int(kinds[b])}), default=9e9)
        right += a < far - 2 * a**2
    return max(0.0, right / len(there) - 0.75) / 0.25


def _make_line(s):
    points = [s.blocks[b] for b in range(len(s.shape)) if s.shape[b] != NOTHING]
    best = 1
    for p, q in itertools.combinations(points, 2):
        along = (q - p) / np.linalg.norm(q - p)
        across = np.array([-along[1], along[0]])
        reach = sorted(along @ (x - p) for x in points if abs(across @ (x - p)) <= 0.18)
        run = 1
        for low, high in itertools.pairwise(reach):
            run = run + 1 if high - low <= 0.42 else 1
            best = max(best, run)
    n = len(points)
    m = max(n - 2, 2)
    return max(0, best - m) / (n - m)


def _match_regions(s):
    there = [b for b in range(len(s.shape)) if s.shape[b] != NOTHING]
    within = [b for b in there if _inside(s.regions[0], s.blocks[b])]
    targets = [b for b in there if s.colour[b] == s.region_colour[0]]
    if not targets or not within:
        return 0.0
    n_t = len({*within} & {*targets})
    return n_t / len(targets) * (1 - (len(within) - n_t) / len(within))


LOOPS = {
    "move_to_corner": _move_to_corner, "move_to_region": _move_to_region, "find_dupe": _find_dupe,
    "fix_colour": _fix_colour, "cluster_colour": lambda s: _cluster(s, s.colour),
    "cluster_shape": lambda s: _cluster(s, s.shape), "make_line": _make_line,
    "match_regions_magical": _match_regions,
}  # fmt: skip


# ---------------------------------------------------------------- scenes drawn at random


def _near(rng, name, shape, colour, regions):
    """Places that often score: in a region, in heaps of a class, on a line."""
    blocks, width = (
        np.empty((*shape.shape, 2)),
        {"make_line": 0.1, "fix_colour": 0.4}.get(name, 0.2),
    )
    heap = rng.uniform(-0.9, 0.9, (MANY, 4, 2))
    for m in range(MANY):
        for b in range(shape.shape[1]):
            middle = heap[m, (shape if name == "cluster_shape" else colour)[m, b] % 4]
            if name in REGIONS:
                middle = regions[m, b % regions.shape[1], :2]
            if name == "make_line":
                middle = heap[m, 0] + (b - 1.5) * rng.uniform(0.2, 0.4) * (heap[m, 1] - heap[m, 2])
            blocks[m, b] = middle + rng.uniform(-width, width, 2)
    return blocks


def _scenes(name):
    """Scenes of any layout, half of them near a success; some slots hold nothing."""
    rng, count = np.random.default_rng(0), TASKS[name]
    shape, colour = (rng.integers(0, 4, (MANY, count)) for _ in range(2))
    least = {"find_dupe": 7, "fix_colour": 2, "cluster_colour": 7, "cluster_shape": 7}.get(name, 3)
    used = rng.integers(min(least, count), count + 1, MANY)
    shape = np.where(np.arange(count) < used[:, None], shape, NOTHING)
    if name == "find_dupe":
        colour[:, 5], shape[:, 5] = colour[:, 6], shape[:, 6]
        missing = np.arange(7) < rng.integers(0, 5, (MANY, 1))
        shape = np.where(missing & (np.arange(7) < 5), NOTHING, shape)
    held = REGIONS.get(name, 0)
    regions = np.concatenate([rng.uniform(-0.7, 0.7, (MANY, held, 2)),
                              rng.uniform(0.4, 0.8, (MANY, held, 2))], axis=2)  # fmt: skip
    gone = shape[:, :held] == NOTHING if name == "fix_colour" else np.zeros((MANY, held), bool)
    regions[gone, 2:] = 0.0
    blocks = np.where(
        rng.random((MANY, 1, 1)) < 0.5,
        rng.uniform(-1, 1, (MANY, count, 2)),
        _near(rng, name, shape, colour, regions),
    )
    blocks = np.where((shape == NOTHING)[..., None], 2.0, blocks)
    region_colour = rng.integers(0, 4, (MANY, held))
    if name == "fix_colour":  # as the task draws them: all but one block have the region's colour
        odd = np.arange(3) == rng.integers(0, used, MANY)[:, None]
        region_colour = np.where(odd, (colour + 1) % 4, colour)
    return Scene(
        rng.uniform(-1, 1, (MANY, 2)).astype(np.float32), blocks.astype(np.float32),
        shape.astype(np.int32), colour.astype(np.int32), regions.astype(np.float32),
        region_colour.astype(np.int32),
    )  # fmt: skip


@pytest.mark.parametrize("name", TASKS)
def test_scores_are_their_formulas(name):
    scenes = _scenes(name)
    env = envs.make(name, variant="all")
    found = np.asarray(jax.jit(jax.vmap(env.score))(jax.tree.map(jnp.asarray, scenes)))
    exact = jax.tree.map(lambda f: f.astype(np.float64), scenes)
    wanted = [LOOPS[name](jax.tree.map(lambda f, m=m: f[m], exact)) for m in range(MANY)]
    np.testing.assert_allclose(found, wanted, atol=2e-6)
    assert np.mean(np.asarray(wanted) > 0) > 0.03  # or little would be told
    assert np.mean(np.asarray(wanted) < 1) > 0.05


# ---------------------------------------------------------------- edges


def _scene(blocks=(), names=(), *, robot=(0.0, 0.0), regions=(), region_colours=()):
    split = [name.split() for name in names]
    return Scene(
        jnp.array(robot),
        jnp.array(blocks, jnp.float32).reshape(-1, 2),
        jnp.array([SHAPES.index(s) for _, s in split], jnp.int32),
        jnp.array([COLOURS.index(c) for c, _ in split], jnp.int32),
        jnp.array(regions, jnp.float32).reshape(-1, 4),
        jnp.array([COLOURS.index(c) for c in region_colours], jnp.int32),
    )


@functools.cache
def _scorer(name):
    return jax.jit(envs.make(name).score)


def _score(name, *args, **of):
    return float(_scorer(name)(_scene(*args, **of)))


@pytest.mark.parametrize(
    ("place", "score"),
    [((-1.0, 0.0), 0.5858), ((-1.0, 1.0), 1.0), ((-0.5, 0.5), 1.0), ((0.0, 0.0), 0.0),
     ((-1.0, 1 - 0.7072), 1.0), ((-1.0, 1 - 1.06066), 0.5), ((-1.0, -0.4142), 0.0)],
)  # fmt: skip
def test_the_corner_is_a_quarter_disc_with_a_slope_around_it(place, score):
    assert _score("move_to_corner", [place], ["red square"]) == pytest.approx(score, abs=2e-4)


@pytest.mark.parametrize("x", [-0.25, 0.75])
@pytest.mark.parametrize("inwards", [-1e-4, 0.0, 1e-4])
def test_a_region_is_closed(x, inwards):
    box, at = (0.25, -0.5, 1.0, 0.5), x + (inwards if x < 0 else -inwards)
    assert _score("move_to_region", robot=(at, -0.25), regions=[box]) == float(inwards >= 0)
    assert _score("move_to_region", robot=(0.25, -0.7501), regions=[box]) == 0


DUPES = ["green pentagon", "red circle", "yellow square", "blue star", "yellow pentagon"]


@pytest.mark.parametrize(
    ("within", "score"),
    [([6], 0), ([5], 0), ([5, 6], 1), ([4, 5], 1), ([4, 5, 6], 1), ([5, 6, 0], 2 / 3),
     ([5, 6, 0, 1], 0.5), ([4, 5, 6, 2], 0.75), ([6, 0, 1, 2, 3], 0)],
)  # fmt: skip
def test_at_least_two_alike_must_be_inside_and_others_cost(within, score):
    """Block 4 is a twin of the query, 6; block 2 has its colour alone."""
    names = [*DUPES, "yellow pentagon", "yellow pentagon"]
    blocks = [(0.0, 0.1 * b) if b in within else (0.9, 0.0) for b in range(7)]
    region = dict(regions=[(0, 0.3, 0.5, 0.8)], region_colours=["yellow"])
    assert _score("find_dupe", blocks, names, **region) == pytest.approx(score)


@pytest.mark.parametrize(
    ("places", "score"),
    [((0, 1, 2), 0), ((0, 1, None), 1), ((0, 1, 0), 0), ((0, 1, 1), 0), ((None, 1, None), 0),
     ((1, 0, None), 0), ((0, 1, "outside"), 1), ((0, 0, None), 0)],
)  # fmt: skip
def test_each_region_must_have_its_own_block_alone(places, score):
    """The third block is blue, like the second region; its own region is red."""
    where = {0: (-0.5, 0.5), 1: (0.5, 0.5), 2: (0.5, -0.5), None: (0.0, 0.0), "outside": (0, -0.9)}
    regions = [(*where[r], 0.5, 0.5) for r in range(3)]
    found = _score(
        "fix_colour", [where[p] for p in places], ["green star", "blue square", "blue circle"],
        regions=regions, region_colours=["green", "blue", "red"],
    )  # fmt: skip
    assert found == score


def _heaps(wrong):
    """Eight red and blue blocks in two heaps, some of them in the heap of the others."""
    names = ["red circle"] * 4 + ["blue star"] * 4
    x = [-0.8] * 4 + [0.8] * 4
    blocks = [(x[b] if b not in wrong else -x[b], 0.2 * (b % 4)) for b in range(8)]
    return blocks, names


@pytest.mark.parametrize(("wrong", "score"), [([], 1.0), ([0], 0.5), ([0, 5], 0.0), ([0, 1], 0.0)])
def test_a_cluster_counts_blocks_from_three_quarters_on(wrong, score):
    for name in ("cluster_colour", "cluster_shape"):
        assert _score(name, *_heaps(wrong)) == pytest.approx(score, abs=1e-6)


OTHERS = [(7, 1, 3 / 7), (9, 2, 1 / 9), (9, 1, 5 / 9), (10, 2, 0.2), (10, 1, 0.6)]


@pytest.mark.parametrize(("count", "wrong", "score"), OTHERS)
def test_other_numbers_of_blocks_have_other_steps(count, wrong, score):
    """Two heaps of one class each; `wrong` blocks of the first lie in the second."""
    names = ["red circle"] * (count - 3) + ["blue star"] * 3
    far = [b < wrong or b >= count - 3 for b in range(count)]
    blocks = [(0.8 if f else -0.8, 0.05 * b) for b, f in enumerate(far)]
    assert _score("cluster_colour", blocks, names) == pytest.approx(score, abs=1e-5)


def test_a_block_as_near_to_another_class_as_allowed_is_wrong():
    """At a = 0.5 from its own mean b must exceed 1."""
    names = ["red circle", "red circle", "blue star", "blue star"]
    for away, right in ((-1.0, 2 / 4), (-1.01, 4 / 4)):
        blocks = [(0.0, 0.0), (1.0, 0.0), (away, 0.0), (away, 0.0)]
        share = max(0.0, right - 0.75) / 0.25
        assert _score("cluster_colour", blocks, names) == pytest.approx(share)


def test_a_single_block_is_right_wherever_it_is():
    names = ["red circle", "green star", "blue star", "yellow star"]
    blocks = [(0.0, 0.0), (0.1, 0.0), (0.2, 0.0), (0.3, 0.0)]
    assert _score("cluster_colour", blocks, names) == 1


LINE = ["blue star", "yellow circle", "red star", "green pentagon"]


@pytest.mark.parametrize(
    ("blocks", "score"),
    [
        ([(0, 0), (0.42, 0), (0.84, 0), (1.26, 0)], 1),  # as far apart as may be
        ([(0, 0), (0.421, 0), (0.84, 0), (1.2, 0)], 0.5),  # a gap
        ([(0, 0), (0.421, 0), (0.843, 0), (1.265, 0)], 0),  # nothing but gaps
        ([(0, 0), (0.3, 0.18), (0.6, 0.0), (0.9, 0.0)], 1),  # as far aside as may be
        ([(0, 0), (0.3, 0.0), (0.6, 0.0), (0.9, 0.6)], 0.5),
        ([(0, 0), (0.6, 0.0), (0.3, 0.0), (-0.3, 0.01)], 1),  # in any order
        ([(0, 0), (0.25, 0), (0, 0.25), (0.25, 0.25)], 1),  # a clump is a line by its diagonal
        ([(0, 0), (0.2545, 0), (0, 0.2545), (0.2545, 0.2545)], 1),
        ([(0, 0), (0.256, 0), (0, 0.256), (0.256, 0.256)], 0),  # but not if it is wider
        ([(0, 0), (0.24, 0), (0.12, 0.2078), (0.36, 0.2078)], 1),  # a close-packed rhombus
        ([(0, 0), (0.24, 0), (0.48, 0), (0.48, 0.24)], 1),  # a bend by 90 degrees
        ([(0, 0), (0.3, 0), (0.6, 0), (0.6, 0.3)], 0.5),
    ],
)
def test_lines_clumps_and_bends_are_lines_as_the_original_counts(blocks, score):
    for turn in (0.0, 0.7, 2.0):
        c, s = math.cos(turn), math.sin(turn)
        if turn and any(abs(x - 0.42) < 1e-6 or abs(y - 0.18) < 1e-6 for x, y in blocks):
            continue  # edges are exact along the axes alone
        turned = [(c * x - s * y, s * x + c * y) for x, y in blocks]
        assert _score("make_line", turned, LINE) == score


@pytest.mark.parametrize(("y", "score"), [(0.0, 1), (0.5, 0)])
def test_of_three_blocks_all_must_be_on_the_line(y, score):
    scene = _scene([(0, 0), (0.3, 0), (0.6, y), (2.0, 0)], LINE)
    scene = scene._replace(shape=scene.shape.at[3].set(NOTHING))
    assert float(envs.make("make_line", variant="all").score(scene)) == score
