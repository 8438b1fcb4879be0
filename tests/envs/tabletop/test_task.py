"""Common parts of the tasks on the table: options and the contract of an environment."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.panda.kinematics import Frame, about_z
from gril_jax.envs.tabletop import boxes as cameras
from gril_jax.envs.tabletop import reward as rewards
from gril_jax.envs.tabletop import task as observations
from gril_jax.envs.tabletop.boxes import Boxes
from gril_jax.envs.tabletop.physics import Motion
from gril_jax.envs.tabletop.reward import StageProgress

from gril_jax import envs


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reward": "dense"}, "reward is 'dense', but must be one of staged"),
        ({"jitter": 1.5}, "jitter is 1.5, but must be between 0 and 1"),
        ({"substeps": 0}, "substeps is 0, but must be at least 1"),
        ({"episode_length": 0}, "episode_length is 0"),
    ],
)
def test_options_out_of_range_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        envs.make("shoes_in_box", **options)


def test_each_number_has_a_name_and_reset_keeps_its_types():
    env = envs.make("shoes_in_box")
    assert isinstance(env, envs.Env)
    first = jax.eval_shape(env.reset, jax.random.key(0))
    assert first.obs.shape == (env.observation_size,) == (len(env.observation_names),)
    assert len(set(env.observation_names)) == env.observation_size
    assert env.action_size == len(env.action_names)
    assert not any(leaf.weak_type for leaf in jax.tree.leaves(first))


@pytest.fixture(scope="module")
def layout():
    """The task and its start without any jitter."""
    env = envs.make("shoes_in_box", jitter=0.0)
    return env, jax.jit(env.reset)(jax.random.key(0))


def test_boxes_in_space_and_in_the_view_are_in_the_order_of_the_classes(layout):
    env, state = layout
    boxes = env.world_boxes(state.data)
    assert boxes.position.shape == (len(env.classes), 3)
    assert state.objects.is_robot.tolist() == [True] * 3 + [False] * 4
    seen = cameras.project(env.camera, boxes)
    np.testing.assert_allclose(state.objects.center, seen[0], atol=1e-5)
    np.testing.assert_allclose(state.objects.size, seen[1], atol=1e-5)
    hand, shoe = env.classes.index("hand"), env.classes.index("shoe B")
    np.testing.assert_allclose(boxes.position[hand, :2], [0.5, 0.05], atol=2e-3)
    np.testing.assert_allclose(boxes.position[shoe], [0.48, 0.27, 0.025], atol=1e-6)
    outlines = env.outlines(state.data)
    assert len(outlines) == len(env.classes)
    assert all((np.abs(outline.vertices) <= env.half_extent).all() for outline in outlines)


def test_observed_places_are_from_the_hand(layout):
    env, state = layout
    seen = dict(zip(env.observation_names, np.asarray(state.obs), strict=True))
    hand = [seen[f"hand {p}"] for p in "xyz"]
    shoe = [seen[f"shoe B {p}"] for p in "xyz"]
    np.testing.assert_allclose(np.add(hand, shoe), [0.48, 0.27, 0.025], atol=1e-6)
    np.testing.assert_allclose([seen[f"hand z axis {p}"] for p in "xyz"], [0, 0, -1], atol=1e-3)
    assert seen["joint 4"] == pytest.approx(-2.2644)
    assert jnp.isfinite(state.obs).all()


# --- Each number of an observation is what its name says


def test_every_number_is_under_its_name():
    rng = np.random.default_rng(0)
    draw = lambda *shape: jnp.asarray(rng.normal(size=shape), jnp.float32)  # noqa: E731
    motion = Motion(draw(16), draw(15), draw(15))
    target, action, place = draw(8), draw(2), draw(2, 3)
    hand = Frame(draw(3), about_z(jnp.float32(0.3)))
    things = Boxes(place, about_z(jnp.array([0.0, 1.0])), draw(2, 3))
    reached = jnp.array([True, False])
    found = observations.observe(motion, target, hand, things, reached, action)
    names = observations.names(("cup", "lid"), ("open", "shut"), ("a", "b"), rates=6)
    assert len(names) == len(set(names)) == len(found)
    seen = dict(zip(names, np.asarray(found), strict=True))
    wanted = {
        "joint 3": motion.qpos[2], "opening": motion.qpos[7], "opening rate": motion.qvel[7],
        "joint 2 lead": target[1] - motion.qpos[1], "hand y": hand.position[1],
        "hand y axis x": -np.sin(0.3), "hand z axis z": 1.0,
        "lid z": place[1, 2] - hand.position[2], "lid x axis y": np.sin(1.0),
        "lid y axis x": -np.sin(1.0), "cup y axis y": 1.0, "rate 0": motion.qvel[9],
        "rate 5": motion.qvel[14], "reached open": 1.0, "reached shut": 0.0, "last b": action[1],
    }  # fmt: skip
    for name, value in wanted.items():
        np.testing.assert_allclose(seen[name], value, atol=1e-6, err_msg=name)


def test_only_a_rich_observation_tells_the_stages_that_have_been_reached():
    rich, plain = (envs.make("umbrella_out", observation=kind) for kind in ("rich", "plain"))
    told = {f"reached {stage}" for stage in rich.stage_names}
    assert {*rich.observation_names} - {*plain.observation_names} == told
    obs = jax.eval_shape(plain.reset, jax.random.key(0)).obs
    assert obs.shape == (plain.observation_size,) == (len(plain.observation_names),)


# --- Records and rewards of stages along made-up episodes

STAGES = 3


def _moment(done, within=0.0, finished=False):
    flags = jnp.arange(STAGES) < done
    return StageProgress(flags, jnp.float32(within), jnp.array(finished))


def _episode(moments):
    record, records = rewards.no_record(STAGES), []
    for time, moment in enumerate(moments):
        record = rewards.record(record, moment, jnp.int32(time))
        records.append(record)
    return records


def test_stage_times_are_the_first_ones():
    times = _episode([_moment(k) for k in (0, 1, 0, 1, 2)])[-1].stage_time
    assert times.tolist() == [1, 4, -1]


def test_success_needs_five_moments_in_a_row():
    finished = [True] * 4 + [False] + [True] * 6
    found = _episode([_moment(3, finished=f) for f in finished])
    assert [bool(r.success) for r in found] == [False] * 9 + [True] * 2


def _rewards(name, moments, change=0.0):
    records = [rewards.no_record(STAGES), *_episode(moments)]
    steps = zip(records[:-1], records[1:], moments, strict=True)
    move = jnp.full(2, change)
    return [float(rewards.reward(name, a, b, m, move)) for a, b, m in steps]


def test_stage_bonuses_are_paid_once():
    found = _rewards("staged", [_moment(k) for k in (0, 1, 0, 1, 2, 1, 2)])
    np.testing.assert_allclose(found, [0, 1 + 1 / 3, 0, 1 / 3, 1 + 2 / 3, 1 / 3, 2 / 3], atol=1e-6)


def test_success_is_paid_once_more():
    moments = [_moment(3, finished=True)] * 7
    found = _rewards("staged", moments)
    np.testing.assert_allclose(found, [4, 1, 1, 1, 6, 1, 1], atol=1e-6)


def test_progress_counts_within_the_next_stage_and_changes_cost():
    found = _rewards("staged", [_moment(0, 0.6)], change=1.0)
    assert found == pytest.approx([0.2 - 0.02])
    assert _rewards("staged", [_moment(3, 0.9)])[0] == pytest.approx(1 + 3)


def test_stage_count_and_sparse_pay_nothing_else():
    moments = [_moment(1, 0.7), *[_moment(3, 0.7, True)] * 5]
    np.testing.assert_allclose(_rewards("stages", moments), [1 / 3, 1, 1, 1, 1, 1], atol=1e-6)
    assert _rewards("sparse", moments) == [0, 0, 0, 0, 0, 1]


def test_closeness_falls_from_one():
    points = [jnp.array([d, 0.0, 0.0]) for d in (0.0, 0.2, 2.0)]
    found = [float(rewards.closeness(p, jnp.zeros(3))) for p in points]
    np.testing.assert_allclose(found, [1, 1 - np.tanh(1.0), 0], atol=1e-4)
