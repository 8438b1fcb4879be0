"""Training episodes that begin within one of the expert's: what they take over, and how many do."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import registry
from gril_jax.envs.panda import kinematics
from gril_jax.envs.tabletop.environment import Tabletop
from gril_jax.envs.tabletop.moves import CLOSED, Hand
from gril_jax.envs.tabletop.recorded import moments
from gril_jax.envs.tabletop.tasks.shoes_in_box import ENTRY, SCRIPT, TASK

from gril_jax import envs
from gril_jax.config import EnvConfig
from gril_jax.workflows.build import setup


@pytest.fixture(scope="module")
def plain():
    return ENTRY.make()


@pytest.fixture(scope="module")
def found(plain):
    return moments(plain, SCRIPT.perform, episodes=3)


@pytest.fixture(scope="module")
def begun(found):
    """Many starts, all of them within an episode."""
    env = Tabletop(TASK, varied_starts=1.0, moments=found)
    return jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(1), 256))


def test_moments_are_those_of_successes_before_they_succeed(plain, found):
    assert len(found.best) > 100
    assert set(found.best) <= {0, 1, 2, 3}
    assert (found.reached.sum(axis=1) >= found.best).all()
    first = found.best == 0
    assert not found.reached[first].any()
    # The box stands still; both shoes have moved once they are in.
    names = plain.classes
    assert not found.moved[:, names.index("box")].any()
    inside = found.reached[:, 1] & found.reached[:, 2]
    assert found.moved[inside][:, [names.index("shoe A"), names.index("shoe B")]].all()


def test_an_episode_takes_over_where_things_are_and_what_has_been_done(found, begun):
    known = {row.tobytes(): i for i, row in enumerate(np.asarray(found.qpos))}
    at = [known[row.tobytes()] for row in np.asarray(begun.data.motion.qpos)]
    assert len(set(at)) > 50
    np.testing.assert_array_equal(begun.data.motion.qvel, found.qvel[at])
    np.testing.assert_array_equal(begun.data.target, np.asarray(found.target)[at])
    np.testing.assert_array_equal(begun.data.fixtures, found.fixtures[at])
    np.testing.assert_array_equal(begun.moved, found.moved[at])
    np.testing.assert_array_equal(begun.data.record.stage_time >= 0, found.reached[at])
    np.testing.assert_array_equal(begun.data.record.best, found.best[at])
    assert (begun.data.time == 0).all()
    assert not begun.metrics["success"].any()


def test_what_was_done_before_is_not_paid_again(begun):
    done = sum(begun.metrics[f"stage {name}"] for name in TASK.stages)
    assert (begun.reward <= (done + 1) / 3 + 1e-6).all()  # each bonus would be 1


def test_the_rest_of_the_episodes_begin_as_the_task_does(plain, found):
    keys = jax.random.split(jax.random.key(2), 256)
    half = Tabletop(TASK, varied_starts=0.5, moments=found)
    drawn = jax.jit(jax.vmap(half.reset))(keys)
    moved = drawn.moved.any(axis=1)
    assert 0.4 < moved.mean() < 0.6
    own = jax.jit(jax.vmap(plain.reset))(keys)
    # Training counts success only where an episode began as the task does.
    varied = drawn.metrics["varied"] == 1
    assert moved[varied].any()
    assert not moved[~varied].any()
    assert not own.metrics["varied"].any()
    none = jax.jit(jax.vmap(Tabletop(TASK, moments=found).reset))(keys)
    jax.tree.map(np.testing.assert_array_equal, own, none)


def test_the_expert_s_aims_are_those_at_its_moments(plain):
    start = jax.jit(plain.reset)(jax.random.key(3))
    hand = SCRIPT.perform(plain, start, np.random.default_rng(0), "lid only")
    assert len(hand.targets) == len(hand.positions)
    np.testing.assert_array_equal(hand.targets[0], start.data.target)
    # Servos lag behind their aims, but not by much.
    gap = np.stack(hand.positions)[:, :7] - np.stack(hand.targets)[:, :7]
    assert np.abs(gap).max() < 0.3


@pytest.mark.slow
def test_physics_goes_on_from_a_moment(plain, found):
    """Under the aim that was held, a control step moves no thing further than the hand does."""
    step = jax.jit(jax.vmap(plain.physics.step))
    some = jax.tree.map(lambda x: jnp.asarray(x)[::20], found)
    before = jax.vmap(plain.physics.start)(some.qpos)._replace(qvel=some.qvel)
    after = step(before, some.target, some.fixtures)
    assert np.isfinite(after.qpos).all()
    assert np.abs(after.qpos[:, 10:13] - some.qpos[:, 10:13]).max() < 0.03


def test_only_training_has_varied_starts_and_they_must_come_from_somewhere(monkeypatch, plain):
    asked = []
    monkeypatch.setattr(registry, "build", lambda name, options: asked.append(options) or plain)
    config = EnvConfig(name="shoes_in_box", reward="staged", varied_starts=0.3)
    setup.make_env(config, training=True)
    setup.make_env(config, training=False)
    assert [options["varied_starts"] for options in asked] == [0.3, 0.0]
    with pytest.raises(ValueError, match=r"varied_starts is 0\.3, but no recorded states"):
        Tabletop(TASK, varied_starts=0.3)
    with pytest.raises(ValueError, match=r"varied_starts is 2\.0, but must be between 0 and 1"):
        Tabletop(TASK, varied_starts=2.0)


# --- A hand driven in C MuJoCo: it goes where it is told, and gives up where it cannot


@pytest.fixture(scope="module")
def scene():
    env = envs.make("shoes_in_box", jitter=0.0)
    return env, jax.jit(env.reset)(jax.random.key(0))


def test_a_move_is_straight_ends_where_it_should_and_takes_its_time(scene):
    hand = Hand(*scene)
    start = hand.place.copy()
    goal = start + [0.0, 0.1, 0.05]
    hand.move(goal, speed=0.2, yaw=0.5)
    steps = hand.steps
    hand.rest(10)
    arms = jnp.array(hand.positions)[:, :7]
    places = np.asarray(jax.jit(jax.vmap(kinematics.tcp))(arms).position)
    np.testing.assert_allclose(hand.place, goal, atol=3e-3)
    np.testing.assert_allclose(places[-1], goal, atol=0.01)
    assert hand.yaw == pytest.approx(0.5, abs=0.06)
    assert steps == pytest.approx(np.linalg.norm(goal - start) / 0.2 * 20, abs=4)
    away = np.cross(places - start, (goal - start) / np.linalg.norm(goal - start))
    assert np.linalg.norm(away, axis=1).max() < 0.012


def test_a_place_out_of_reach_is_given_up(scene):
    hand = Hand(*scene)
    hand.move((0.5, 1.5, 0.3), speed=0.5)
    assert hand.steps < 120
    assert np.isfinite(hand.positions).all()


def test_the_gripper_closes_and_opens_again(scene):
    hand = Hand(*scene)
    hand.close()
    assert hand.grip == CLOSED
    assert hand.qpos[7] < 0.005
    hand.open()
    assert hand.qpos[7] > 0.03
    assert len(hand.positions) == len(hand.velocities) == hand.steps + 1


def test_nothing_happens_beyond_the_limit(scene):
    hand = Hand(*scene, limit=3)
    hand.rest(5)
    hand.move((0.5, 0.2, 0.3), speed=0.1)
    assert hand.steps == 3
