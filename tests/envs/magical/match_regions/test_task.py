"""The contract of tasks: every one that is registered, every robot and variant of MatchRegions.

Variants are data: one compiled step of a robot serves them all, the gripper's the whole file. The
sticks have two blocks here, which compile faster; with five they play in the tests of
`planar_physics`.
"""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.base import ExpertError, Wanted
from gril_jax.envs.magical import layout as layouts
from gril_jax.envs.magical.match_regions import expert, task
from gril_jax.envs.planar import robots
from support import match_regions_lanes as lanes
from support.match_regions_lanes import LANES

from gril_jax import envs

EXTREME = [-1e30, -1e3, -1.0, 0.0, 1.0, 1e3, 1e30]
FEW = {"targets": ("green star",), "distractors": ("yellow circle",)}
ROLLOUTS = [  # what moves differently plays in the tests of physics, too
    {"robot": "short", "variant": "all", "reward": "V5", "observation": "xmagical"},
    {"physics": "magical", "variant": "all", "observation": "xmagical", "reward": "V5"},
    {"robot": "medium", "variant": "all"},
    {"robot": "long", "variant": "all", "reward": "sparse"},
]


def _actions(size):
    """1,024 random actions, 64 of each lane, then 256 of extreme numbers."""
    rng = np.random.default_rng(0)
    for t in range(80):
        shape = (LANES, size)
        action = rng.uniform(-1, 1, shape) if t < 64 else rng.choice(EXTREME, shape)
        yield jnp.asarray(action, jnp.float32)


def _check_episodes(env, step, first):
    """Plays them and checks every eighth state."""
    state, blocks = first, len(env.blocks)
    for t, action in enumerate(_actions(env.action_size)):
        state = step(state, action)
        if t % 8 == 3:
            chex.assert_tree_all_finite(state)
            chex.assert_trees_all_equal_shapes_and_dtypes(state, first)
            centres = np.asarray(state.data.pose)[:, -blocks:, :2]
            assert np.abs(centres).max() < env.arena - 0.05
    assert jax.tree.structure(state) == jax.tree.structure(first)
    assert np.abs(np.asarray(state.data.pose - first.data.pose))[:, 0, :2].max() > 0.3


def test_episodes_of_every_variant_stay_finite_and_in_the_arena_with_one_compiled_step():
    """16 lanes: two of each variant, and two of varied starts."""
    options = [{"variant": v} for v in layouts.VARIANTS] + [{"varied_starts": 0.5}]
    drawn = [jax.tree.map(lambda leaf: leaf[:2], lanes.starts(**o)[1]) for o in options]
    first = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *drawn)
    assert first.reward.shape == (LANES,)
    _check_episodes(lanes.task(), lanes.step(), first)


def _label(options):
    return "-".join(options.values())


@pytest.mark.parametrize(
    "options", [pytest.param(o, marks=pytest.mark.slow) for o in ROLLOUTS], ids=_label
)
def test_episodes_of_every_robot_stay_finite_and_in_the_arena_and_compile_once(options):
    env = envs.make("match_regions", **options, **FEW)
    chex.clear_trace_counter()  # it counts by a function's name
    step = jax.jit(chex.assert_max_traces(lambda s, a: jax.vmap(env.step)(s, a), n=1))
    first = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(2), LANES))
    _check_episodes(env, step, first)


def _same_types(first, after):
    """Weak types too: one that changes would make a jitted step compile twice."""
    assert jax.tree.leaves(first) == jax.tree.leaves(after)
    assert jax.tree.structure(first) == jax.tree.structure(after)
    assert all(not leaf.weak_type for leaf in jax.tree.leaves(after))


@pytest.mark.parametrize(
    ("robot", "variant"),
    [("gripper", v) for v in layouts.VARIANTS] + [(r, "layout") for r in robots.ROBOTS[1:]],
)
def test_every_variant_keeps_its_structure_and_names_each_number(robot, variant):
    env = envs.make("match_regions", robot=robot, variant=variant)
    first = jax.eval_shape(env.reset, jax.random.key(0))
    assert first.obs.shape == (env.observation_size,) == (len(env.observation_names),)
    assert env.action_size == len(env.action_names) == (3 if robot == "gripper" else 2)
    _same_types(first, jax.eval_shape(env.step, first, jnp.zeros(env.action_size)))


# ---------------------------------------------------------------- what a step does


@pytest.fixture(scope="module")
def demo():
    return lanes.demo()


def test_actions_beyond_the_box_act_like_its_border(demo):
    action = np.tile([7.0, -7.0, 7.0], (LANES, 1))
    a = lanes.step()(demo, jnp.asarray(action, jnp.float32))
    b = lanes.step()(demo, jnp.asarray(np.sign(action), jnp.float32))
    chex.assert_trees_all_equal(a, b)


def test_nearest_is_the_least_distance_since_reset(demo):
    """The robot of the Demo start drives away from the square and, later, back."""
    state, least = demo, np.asarray(demo.data.progress.nearest)
    for t in range(10):
        action = jnp.tile(jnp.array([1.0 if t < 5 else -1.0, 0.0, 0.0]), (LANES, 1))
        state = lanes.step()(state, action)
        pose = np.asarray(state.data.pose)
        least = np.minimum(least, np.linalg.norm(pose[:, 3:5, :2] - pose[:, :1, :2], axis=2))
        np.testing.assert_allclose(state.data.progress.nearest, least, rtol=1e-5)


def test_the_task_itself_never_ends(demo):
    state = lanes.step()(demo, jnp.ones((LANES, 3)))
    assert not demo.done.any()
    assert not state.done.any()


def test_tasks_that_move_alike_share_what_is_longest_to_trace():
    """And those with another robot, another number of blocks or other sweeps do not."""
    one = envs.make("match_regions")
    for alike in ({}, {"variant": "layout"}, {"reward": "sparse"}, {"observation": "sorted"}):
        assert envs.make("match_regions", **alike)._engine is one._engine
    for other in (
        {"robot": "short"},
        {"distractors": ()},
        {"iterations": 4},
        {"physics": "magical"},
    ):
        assert envs.make("match_regions", **other)._engine is not one._engine


# --- Options of MatchRegions: wrong ones are refused in one sentence


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"variant": "demos"}, ["variant", "'demos'", "demo, jitter, layout"]),
        ({"targets": ("pink star",)}, ["'pink star'", "green star"]),
        ({"targets": ("goal",)}, ["'goal'"]),
        ({"targets": ()}, ["targets", "at least one"]),
        ({"robot": "sticks"}, ["robot", "'sticks'", "gripper, short, medium, long"]),
        ({"physics": "mujoco"}, ["physics", "'mujoco'", "xmagical, magical"]),
        ({"observation": "state"}, ["observation", "'state'", "rich, sorted, xmagical"]),
        ({"reward": "sparce"}, ["reward", "'sparce'", "did you mean 'sparse'"]),
        ({"varied_starts": 1.5}, ["varied_starts", "1.5", "between 0 and 1"]),
        ({"on_the_way": -0.5}, ["on_the_way", "-0.5", "between 0 and 1"]),
        ({"substeps": 0}, ["substeps", "0", "at least 1"]),
        ({"iterations": 0}, ["iterations", "0", "at least 1"]),
        ({"episode_length": 0}, ["episode_length", "0", "at least 1"]),
        ({"distractors": ("red star",)}, ["'red star'", "demo layout"]),
        ({"distractors": ("red star",), "variant": "jitter"}, ["'red star'", "jitter layout"]),
    ],
)
def test_a_wrong_option_is_one_sentence_that_names_it(options, words):
    with pytest.raises(ValueError) as error:  # noqa: PT011
        envs.make("match_regions", **options)
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_task_is_one_sentence_with_the_known_ones():
    expected = (
        r"did you mean 'match_regions'\?\): the tasks are match_regions, .*shoes_in_box, "
        r".*empty_container, and any"
    )
    with pytest.raises(ValueError, match=expected):
        envs.make("match_region")


def test_other_blocks_make_another_scene():
    env = envs.make(
        "match_regions",
        targets=("red circle",),
        distractors=("blue star", "green square"),
        variant="layout",
    )
    state = jax.eval_shape(env.reset, jax.random.key(0))
    assert env.blocks == ("red circle", "blue star", "green square")
    assert state.obs.shape == (14 + 36,)
    assert state.data.progress.start_distance.shape == (1,)


def test_classes_are_the_detectors():
    from gril_jax.demos.vision.palette import PALETTE_CLASSES

    assert task.CLASSES == PALETTE_CLASSES


def test_rows_of_objects_are_in_the_order_of_the_boxes_and_say_colour_and_shape():
    blocks = {"targets": ("green star",), "distractors": ("yellow circle", "blue pentagon")}
    env = envs.make("match_regions", observation="objects", **blocks)
    state = jax.jit(env.reset)(jax.random.key(0))
    (regions, region), (count, block) = env.observation_rows
    assert (regions, count, state.obs.shape) == (1, 3, (len(env.observation_names),))
    rows = state.obs[-count * block :].reshape(count, block)
    named = env.observation_names[-block:]
    place = slice(*(named.index("block 3: centre") + np.array([0, 2])))
    np.testing.assert_array_equal(rows[:, place], state.objects.center[2:])
    np.testing.assert_array_equal(
        state.obs[-count * block - region :][2:4], state.objects.center[0]
    )
    for row, name in zip(rows, env.blocks, strict=True):
        said = {w.partition(": ")[2] for w, x in zip(named[-8:], row[-8:], strict=True) if x}
        assert said == set(name.split())
    assert envs.make("match_regions", **FEW).observation_rows is None


def test_what_a_layout_or_the_physics_cannot_show_is_refused():
    for variant in ("demo", "jitter"):
        with pytest.raises(ValueError, match="'green star' is named twice"):
            envs.make("match_regions", targets=("green star",) * 2, variant=variant)
    for variant in ("color", "shape", "all"):  # frames show other colours or shapes than it knows
        assert envs.make("match_regions", variant=variant).place is None
    with pytest.raises(ExpertError, match="physics=xmagical, but it is magical"):
        expert.demonstrate(
            functools.partial(envs.make, "match_regions", physics="magical", **FEW),
            Wanted(4, 0, 0, "demo"), lambda found: None,
        )  # fmt: skip
