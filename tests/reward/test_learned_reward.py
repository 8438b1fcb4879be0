"""A learned reward in use: of a moment, of a rollout, of a recording."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.saved_rewards import CLASSES, CONFIGS, OBJECTS, boxes, made, moment

from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs import activity
from gril_jax.graphs.activity_rule import ActivityRule, from_json
from gril_jax.graphs.scene import scene_graph
from gril_jax.reward import learned_reward
from gril_jax.reward.latent_goal import latent_goal_reward
from gril_jax.reward.learned_reward import LearnedReward

ACTIVE = jnp.array([False, True, True, False, False])
RULE = ActivityRule(tau=0.5, window=2)


def _learned(kind="paper", **changes):
    config = CONFIGS[kind]
    classes = () if kind == "pixel" else CLASSES
    return LearnedReward(
        made(config),
        config,
        classes,
        **({"robots": ("robot",), "objects": OBJECTS, "activity": RULE} if classes else {}),
        **changes,
    )


@pytest.mark.parametrize("kind", ["paper", "ensemble", "interaction", "mlp"])
def test_the_reward_of_a_moment_is_that_of_its_graph(kind):
    learned = _learned(kind)
    center, size = (x[0] for x in boxes(1))
    value = jax.jit(learned)(center, size, ACTIVE)
    graph = moment(learned.config)
    expected = jax.jit(latent_goal_reward)(learned.params, graph, learned.config)
    np.testing.assert_allclose(value, expected, rtol=1e-5)


@pytest.mark.slow
def test_the_reward_of_a_picture_is_that_of_the_encoder():
    learned = _learned("pixel")
    frame = moment(learned.config)
    expected = jax.jit(latent_goal_reward)(learned.params, frame, learned.config)
    np.testing.assert_allclose(jax.jit(learned.of_frame)(frame), expected, rtol=1e-4)


def test_a_rollout_a_scan_and_a_recording_agree():
    learned = _learned()
    center, size = boxes(7)
    step = jax.jit(lambda learned, *given: learned.step(*given))
    memory = learned.init(center[0], size[0])
    rollout = [jax.jit(learned.of_memory)(memory)]
    for frame in zip(center[1:], size[1:], strict=True):
        memory, value = step(learned, memory, *frame)
        rollout.append(value)
    found = jax.jit(learned.trajectory)(center, size)
    np.testing.assert_allclose(found, rollout, rtol=1e-5)
    program = learned_reward._PROGRAMS[learned_reward._along]
    compiled = program._cache_size()
    for length in (1, 4, 7):  # all as one program
        np.testing.assert_allclose(
            learned.trajectory(center[:length], np.asarray(size[:length])), rollout[:length],
            rtol=1e-5,
        )  # fmt: skip
    assert program._cache_size() == compiled + 1
    label, is_robot = learned.label, learned.is_robot
    inside = jax.jit(lambda x: x + learned.trajectory(center, size, label=label, is_robot=is_robot))
    np.testing.assert_allclose(inside(1.0), 1.0 + np.asarray(rollout), rtol=1e-5)

    active = jax.jit(lambda *b: activity.trajectory(*b, tau=0.5, window=2))(center, size)
    assert 0 < np.asarray(active).mean() < 1
    np.testing.assert_array_equal(memory.activity.active, active[-1])
    label, is_robot = learned.label, learned.is_robot

    def graph(t):
        return scene_graph(center[t], size[t], label, is_robot, active[t])

    @jax.jit
    def by_hand(t):
        return latent_goal_reward(learned.params, graph(t), learned.config)

    np.testing.assert_allclose(found, [by_hand(t) for t in range(7)], rtol=1e-5)


def test_every_option_of_the_activity_rule_is_used():
    center, size = boxes(9)
    for rule in (
        ActivityRule(0.5, 3, smoothing=3, noise=0.2),
        ActivityRule(1.5, 2),
    ):
        memory, step = rule.init(center[0]), jax.jit(rule.step)
        bits = [memory.active]
        for frame in zip(center[1:], size[1:], strict=True):
            memory, active = step(memory, *frame)
            bits.append(active)
        whole = functools.partial(activity.trajectory, **rule._asdict())
        expected = jax.jit(whole)(center, size)
        np.testing.assert_array_equal(bits, expected)
        assert from_json(rule._asdict()) == rule


def test_it_says_in_a_line_what_it_is_of():
    learned = _learned()
    assert repr(learned) == f"<learned reward of {', '.join(OBJECTS)}>"
    some = repr(dataclasses.replace(learned, objects=()))
    assert some == f"<learned reward of any objects of {len(CLASSES)} classes>"


def test_it_is_an_argument_of_a_compiled_function_or_a_constant_in_one():
    learned = _learned()
    center, size = (x[0] for x in boxes(1))
    count = 0

    @jax.jit
    def value(learned, center):
        nonlocal count
        count += 1
        return learned(center, size, ACTIVE)

    other = dataclasses.replace(learned, params=learned.params._replace(scale=jnp.float32(1.4)))
    np.testing.assert_allclose(value(other, center), 2 * value(learned, center), rtol=1e-6)
    assert count == 1


def test_vmap_equals_a_loop_and_the_gradient_is_finite():
    learned = _learned()
    center, size = boxes(3)
    value = jax.jit(lambda c, s: learned(c, s, ACTIVE))
    many = jax.jit(jax.vmap(value))(center, size)
    np.testing.assert_allclose(many, [value(*x) for x in zip(center, size, strict=True)], rtol=1e-5)
    gradient = jax.jit(jax.grad(value))(center[0], size[0])
    towards = jnp.zeros_like(gradient).at[2, 0].set(1e-3)
    slope = value(center[0] + towards, size[0]) - value(center[0] - towards, size[0])
    np.testing.assert_allclose(gradient[2, 0], slope / 2e-3, rtol=2e-2)


def test_labels_that_are_given_stand_in_for_the_scenes():
    learned = _learned()
    center, size = (x[0] for x in boxes(1))
    value = jax.jit(lambda learned, **given: learned(center, size, ACTIVE, **given))
    expected = value(learned)
    bare = learned.for_objects(())
    assert value(bare, label=learned.label) == expected
    assert value(bare, label=learned.label, is_robot=learned.is_robot) == expected
    assert value(learned.for_objects(["goal", "robot", "star", "star", "star"])) != expected
    assert value(learned, is_robot=~learned.is_robot) != expected


def test_padding_does_not_count():
    learned = _learned()
    center, size = (x[0] for x in boxes(1))
    value = jax.jit(lambda c: learned(c, size, ACTIVE, present=jnp.arange(5) != 4))
    assert value(center) == value(center.at[4].set(9.0))
    fewer = jax.jit(learned.for_objects(OBJECTS[:4]))(center[:4], size[:4], ACTIVE[:4])
    np.testing.assert_allclose(value(center), fewer, rtol=1e-5)


CENTER, SIZE = (x[0] for x in boxes(1))


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda r: r(CENTER, SIZE[:4], ACTIVE), ShapeError, r"size .*\(4, 2\).*\(5, 2\)"),
        (lambda r: r(CENTER[None], SIZE[None], ACTIVE), ShapeError, r"must be \(N, 2\)"),
        (lambda r: r(CENTER, SIZE, ACTIVE[:4]), ShapeError, r"active .*\(4,\).*\(5, 2\)"),
        (lambda r: r(CENTER[:4], SIZE[:4], ACTIVE[:4]), ShapeError, r"label .*\(5,\).*\(4, 2\)"),
        (lambda r: r(CENTER, SIZE, ACTIVE, present=ACTIVE[:2]), ShapeError, "present"),
        (lambda r: r(CENTER, SIZE, ACTIVE, label=jnp.arange(5)), ConfigError, "label holds 4"),
        (lambda r: r(CENTER, SIZE, ACTIVE, label=jnp.arange(-1, 4)), ConfigError, "holds -1"),
        (lambda r: r.for_objects(())(CENTER, SIZE, ACTIVE), ConfigError, "label is missing"),
        (lambda r: r.for_objects(["ball"]), ConfigError, "objects names 'ball'; it must be one of"),
        (lambda r: r.of_frame(jnp.zeros((8, 8, 3))), ConfigError, "takes boxes"),
        (lambda r: r.trajectory(CENTER[None], SIZE[None, :4]), ShapeError, r"\(T, N, 2\)"),
        (lambda r: r.step(r.init(CENTER[:3], SIZE[:3]), CENTER, SIZE), ShapeError, r"\(3, 2\)"),
    ],
)
def test_what_does_not_fit_is_named(call, error, text):
    with pytest.raises(error, match=text):
        jax.jit(lambda r: call(r))(_learned()) if "holds" not in text else call(_learned())


def test_an_encoder_of_pictures_says_what_it_takes():
    pictures = _learned("pixel")
    with pytest.raises(ConfigError, match="takes pictures: call of_frame"):
        pictures(CENTER, SIZE, ACTIVE)
    with pytest.raises(ConfigError, match="takes pictures: call of_frame"):
        pictures.init(CENTER, SIZE)
    with pytest.raises(ShapeError, match=r"frame has shape \(2, 8, 8, 3\)"):
        pictures.of_frame.__wrapped__(pictures, jnp.zeros((2, 8, 8, 3)))


@pytest.mark.parametrize("fields", [3, {"tau": "small"}, {"smoothing": 4}, {"noise": -1.0}])
def test_a_rule_out_of_range_is_refused(fields):
    with pytest.raises(ConfigError, match=r"must"):
        from_json(fields)
