"""Steps of MAGICAL's tasks: both engines, counts that vary, and what policies and detectors see."""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.magical.simulator import from_magical
from gril_jax.envs.magical.suite import state as states
from gril_jax.envs.planar.shapes import NOTHING
from support import scenes

from gril_jax import envs
from gril_jax.demos.vision.video import read_video
from gril_jax.workflows.build import filming

TASKS = (
    "move_to_corner", "move_to_region", "find_dupe", "fix_colour", "cluster_colour",
    "cluster_shape", "make_line",
)  # fmt: skip
LANES = 6
_OTHERS = "move_to_corner", "fix_colour", "cluster_colour", "make_line"  # of kinds that are here
MOST_ALIKE = [
    pytest.param(name, marks=pytest.mark.slow) if name in _OTHERS else name for name in TASKS
]


@functools.cache
def _begun(name, variant="all"):
    env = envs.make(name, variant=variant, engine="kernel")
    return env, jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(3), LANES))


@functools.cache
def _step(name, variant="all"):
    lanes = jax.vmap(_begun(name, variant)[0].step)

    def step(*args):
        return lanes(*args)

    step.__name__ = f"step_{name}_{variant}"  # chex counts traces by a function's name
    return jax.jit(chex.assert_max_traces(step, n=1))


@pytest.mark.parametrize("name", MOST_ALIKE)
def test_episodes_stay_finite_and_in_the_arena_with_one_compiled_step(name):
    """Lanes differ in their number of blocks, which is data."""
    _, first = _begun(name)
    state, rng = first, np.random.default_rng(0)
    for _ in range(25):
        ids = np.where(rng.random(LANES) < 0.5, 1, rng.integers(0, 18, LANES))
        state = _step(name)(state, jnp.asarray(from_magical(ids)))
    chex.assert_tree_all_finite(state)
    chex.assert_trees_all_equal_shapes_and_dtypes(state, first)
    pose, shape = np.asarray(state.data.pose), np.asarray(state.data.shape)
    assert np.abs(pose[:, 0, :2]).max() < 1
    assert np.abs(pose[:, 0, :2] - np.asarray(first.data.pose)[:, 0, :2]).max() > 0.2
    blocks = pose[:, 3 : 3 + shape.shape[1]]
    assert np.abs(blocks[shape != NOTHING][:, :2]).max(initial=0) < 1
    np.testing.assert_array_equal(  # what is not there stays where it is
        blocks[shape == NOTHING],
        np.asarray(first.data.pose)[:, 3 : 3 + shape.shape[1]][shape == NOTHING],
    )
    assert (np.asarray(state.reward) == np.asarray(state.metrics["score"])).all()
    assert not np.asarray(state.done).any()


def test_both_engines_move_alike():
    """They differ by rounding, before contacts amplify it."""
    name = "move_to_region"
    slow, (fast, begun) = envs.make(name, variant="all", engine="impulse"), _begun(name)
    assert (slow.engine, fast.engine) == ("impulse", "kernel")
    move, one, two = jax.jit(jax.vmap(slow.step)), begun, begun
    two = two._replace(data=two.data._replace(memory=jnp.zeros((LANES, len(slow._rest)))))
    for action in (1, 1, 4, 10):
        action = jnp.tile(jnp.asarray(from_magical(np.array(action))), (LANES, 1))
        one, two = _step(name)(one, action), move(two, action)
    np.testing.assert_allclose(one.data.pose, two.data.pose, atol=2e-3)
    np.testing.assert_allclose(one.obs[:, :6], two.obs[:, :6], atol=2e-3)


@pytest.mark.parametrize("name", ["find_dupe", "fix_colour", "make_line"])
def test_a_slot_that_holds_nothing_changes_nothing(name):
    """Two of the lanes: the same start with the last empty slot elsewhere."""
    _, begun = _begun(name)
    shape = np.asarray(begun.data.shape)
    lane = int(np.flatnonzero((shape == NOTHING).any(axis=1))[0])
    slot = int(np.flatnonzero(shape[lane] == NOTHING)[0])
    same = jax.tree.map(lambda f: jnp.stack(LANES * [f[lane]]), begun)
    pose = same.data.pose.at[1, 3 + slot, :2].set(same.data.pose[1, 0, :2])  # under the robot
    state = same._replace(data=same.data._replace(pose=pose))
    for _ in range(6):
        state = _step(name)(state, jnp.tile(jnp.array([1.0, 0.0, 1.0]), (LANES, 1)))
    moved = np.delete(np.asarray(state.data.pose), 3 + slot, axis=1)
    np.testing.assert_array_equal(moved[0], moved[1])


# ---------------------------------------------------------------- what is seen


@pytest.mark.parametrize("name", TASKS)
def test_each_number_of_the_observation_is_named(name):
    env = envs.make(name, variant="all", engine="kernel")
    begun = jax.eval_shape(env.reset, jax.random.key(0))
    assert begun.obs.shape == (env.observation_size,)
    assert len(env.observation_names) == env.observation_size
    assert not any("inside" in name for name in env.observation_names)


@pytest.mark.parametrize("name", ["find_dupe", "fix_colour", "cluster_shape", "make_line"])
def test_the_observation_has_zeros_where_nothing_is_and_shapes_where_something_is(name):
    env, begun = _begun(name)
    names, shape = np.array(env.observation_names), np.asarray(begun.data.shape)
    counts = (shape != NOTHING).sum(axis=1)
    assert len(set(counts)) > 1
    for listed, slot in enumerate(env._order.blocks):  # in the order of the objects
        own = np.char.startswith(names, f"block {listed + 1}: ")
        seen = np.asarray(begun.obs)[:, own]
        there = shape[:, slot] != NOTHING
        assert (seen[~there] == 0).all()
        assert (seen[there, -4:].sum(axis=1) == 1).all()  # one of four shapes: its mask, too
        pose = np.asarray(begun.data.pose)[there, 3 + slot, :2]
        np.testing.assert_allclose(seen[there][:, 2:4], pose, atol=1e-6)


@pytest.mark.parametrize("name", TASKS)
def test_the_rows_of_the_observation_are_those_of_its_names(name):
    env = envs.make(name)
    groups = [n.partition(": ")[0] for n in env.observation_names]
    listed = [n for n in dict.fromkeys(groups) if n.startswith(("region", "block"))]
    found = [groups.count(n) for n in listed]
    assert found == [numbers for count, numbers in env.observation_rows for _ in range(count)]


def test_the_observation_is_blind_to_the_score():
    """Two moments alike but for a block on both sides of its region's edge: only places change."""
    env, begun = _begun("find_dupe", "demo")
    names = np.array(env.observation_names)
    pose = begun.data.pose[0]
    edge = begun.data.regions[0, 0, 0] + begun.data.regions[0, 0, 2] / 2
    seen = []
    for aside in (-1e-3, 1e-3):
        data = jax.tree.map(lambda f: f[0], begun.data)
        at = pose.at[3 + 6, 0].set(edge + aside)
        seen.append(np.asarray(states.observe(data._replace(pose=at), 3, env._order)))
    assert np.abs(seen[0] - seen[1]).max() < 3e-3
    assert {n.partition(":")[0] for n in names[np.abs(seen[0] - seen[1]) > 1e-5]} == {
        f"block {1 + [*env._order.blocks].index(6)}"
    }


@pytest.mark.parametrize("name", MOST_ALIKE)
def test_objects_are_the_robot_the_regions_and_the_blocks(name):
    env, begun = _begun(name)
    seen = jax.tree.map(np.asarray, begun.objects)
    regions = len(env.plan.regions)
    # Where there are no blocks, the robot is what has to move, and counts.
    assert seen.is_robot.sum(axis=1).tolist() == LANES * [int(name != "move_to_region")]
    for m in range(LANES):
        labels = [env.classes[label] for label in seen.label[m]]
        assert labels[0] == "robot"
        assert all(label.endswith(" region") for label in labels[1 : 1 + regions])
        there = seen.size[m, :, 0] > 0
        blocks = (np.asarray(begun.data.shape)[m] != NOTHING).sum()
        assert there[1 + regions :].sum() == blocks
        assert (np.abs(seen.center[m][there]) < 1).all()
        assert (np.abs(seen.center[m][~there]).max(axis=1) > 1.2).all() if (~there).any() else True


def test_objects_of_demo_are_in_the_order_that_is_named():
    env, begun = _begun("find_dupe", "demo")
    labels = [env.classes[label] for label in np.asarray(begun.objects.label)[0]]
    assert labels == list(env.object_names)
    assert labels == sorted(labels, key=env.classes.index)
    assert labels.count("yellow pentagon") == labels.count("red circle") == 2


# ---------------------------------------------------------------- stages


@pytest.mark.parametrize("name", TASKS)
def test_all_stages_done_are_a_success_and_the_start_is_none(name):
    env, begun = _begun(name, "demo")
    center, size = begun.objects.center[0], begun.objects.size[0]
    assert float(env.stages.progress(center, size)) == 0
    assert not np.asarray(env.stages.done(center, size)).all()

    def ended(key):
        end, stages = env.stages.fulfil(key, center, size), env.stages
        faults = stages.faulty(end, size).any()
        return stages.done(end, size).all(), stages.progress(end, size), faults

    ends = jax.jit(jax.vmap(ended))(jax.random.split(jax.random.key(0), 40))
    held, score, faults = jax.device_get(ends)
    assert held.mean() > 0.6  # a later heap may lie beside an earlier one
    assert (score[held & ~faults] == 1).all()


@pytest.mark.parametrize("name", ["find_dupe", "fix_colour"])
def test_the_score_of_boxes_is_the_score_of_the_state(name):
    rng, (env, begun) = np.random.default_rng(0), _begun(name, "demo")
    data = jax.tree.map(lambda f: f[0], begun.data)
    count = len(data.shape)
    middle = np.asarray(data.regions)[rng.integers(0, len(data.regions), (4000, count)), :2]
    places = middle + rng.uniform(-0.45, 0.45, (4000, count, 2))

    def both(places):
        now = data._replace(pose=data.pose.at[3:, :2].set(places))
        boxes = states.objects(now, env.robot, env._order)
        return env.score(states.scene(now, 3)), env.stages.progress(boxes.center, boxes.size)

    score, of_boxes = jax.jit(jax.vmap(both))(jnp.asarray(places, jnp.float32))
    np.testing.assert_allclose(score, of_boxes)
    assert len(set(np.asarray(score).tolist())) > 1


# ---------------------------------------------------------------- pictures


def test_only_the_corner_s_block_is_painted_over_the_robot():
    grey, red = (162, 163, 175), (245, 129, 165)
    for name, fill, later in (("move_to_corner", red, True), ("find_dupe", red, False)):
        env, begun = _begun(name, "demo")
        fills = [o.fill for o in env.outlines(jax.tree.map(lambda f: f[0], begun.data))]
        assert (fills.index(fill) > fills.index(grey)) == later


@pytest.mark.parametrize("name", TASKS)
def test_demo_starts_look_like_the_first_frames_of_the_films(name):
    """But for lines, eyes and what compression blurs: fills agree where both are one colour."""
    path = scenes.shared_data() / "magical_suite" / name.replace("_", "-") / "000.mp4"
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    env, begun = _begun(name, "demo")
    data = jax.tree.map(lambda f: np.asarray(f[:1]), begun.data)
    ours = np.asarray(list(filming.outlines(env, data)))[0].astype(int)
    theirs = read_video(path)[0].astype(int)
    assert (np.abs(ours - theirs).max(axis=-1) > 48).mean() < 0.04
    for outline in env.outlines(jax.tree.map(lambda f: f[0], data))[1:]:
        if outline.rim is None:
            continue
        same = (ours == outline.fill).all(axis=-1)
        inner = same & np.roll(same, 3, 0) & np.roll(same, -3, 0)
        inner &= np.roll(inner, 3, 1) & np.roll(inner, -3, 1)
        if inner.sum() > 50:
            off = np.abs(theirs[inner] - outline.fill).max(axis=-1)
            assert np.median(off) <= 4
            assert (off > 24).mean() < 0.05
