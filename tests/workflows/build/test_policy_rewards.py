"""Parameters that a policy's reward gets from the demonstrations."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs import registry
from support.kinematic_demos import kinematic_demos
from support.probes import Probe

from gril_jax.config import EnvConfig, PPOConfig, RunConfig, RunSettings, files
from gril_jax.errors import ConfigError, DemoError
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.reward.staircase import Staircase
from gril_jax.rl import rewards
from gril_jax.rl.episodes import Episodes
from gril_jax.workflows.build import policy_rewards, policy_setup, setup
from gril_jax.workflows.build.starts import Group, draw, evaluated_from, which
from gril_jax.workflows.study import recipe

FRAMES = 140
ENDS = (35, 75, 115)


def _latents(num):
    """A number that falls from 3 to 0 in three steps, each demonstration a little later."""
    frames = np.arange(FRAMES) - 2 * np.arange(num)[:, None]
    return 3 - sum(np.clip((frames - end + 12) / 12, 0, 1) for end in ENDS)


def _films(config, length):
    """Short videos with the task's objects, which each has in another order; and these orders."""
    env = setup.make_env(config.env, training=False)
    label = np.asarray(env.reset(jax.random.key(0)).objects.label)
    orders = np.array(
        [np.random.default_rng(b).permutation(len(label)) for b in range(len(length))]
    )
    demos = kinematic_demos(0, len(length), num_objects=len(label), max_length=20)
    demos = demos._replace(length=jnp.asarray(length), label=jnp.asarray(label[orders]))
    return demos, np.argsort(orders, axis=1)


@pytest.mark.parametrize(
    "task", sorted({row["env.name"] for row in recipe.load("suite").rows.values()})
)
def test_the_reward_of_each_task_of_the_suite_takes_its_states(task):
    config = files.load("magical_suite", [f"--env.name={task}"])
    env = setup.make_env(config.env, training=True)
    algorithm = policy_setup.make_algorithm(config, env)
    begun = jax.eval_shape(algorithm.episodes.begin, jax.random.key(0))
    action = jnp.zeros(env.action_size)
    _, result = jax.eval_shape(
        lambda params, begun: algorithm.episodes.advance(params, begun, action, tau=0.1),
        policy_rewards.blank(config, env),
        begun,
    )
    assert result.reward.shape == ()


def test_frames_to_begin_at_are_those_of_the_videos_with_what_has_moved_in_them():
    """Evenly over all frames, none of the padding, in order of videos and time, and each object
    where the task has it."""
    length = np.array([20, 7, 1, 20, 13, 20])
    config = RunConfig(ppo=PPOConfig(video_state_resets=0.5))
    demos, place = _films(config, length)
    learned = RewardParams({}, jnp.zeros(1), jnp.ones(()), jnp.ones(()))
    made = policy_rewards.parameters(config, learned, demos, 18)
    assert made.reward is learned
    center = np.asarray(demos.center)
    shown = np.concatenate([center[b, :n][:, place[b]] for b, n in enumerate(length)])
    every = np.linspace(0, len(shown) - 1, 2048).round().astype(int)
    np.testing.assert_array_equal(made.frames.center, shown[every])
    first, last = made.frames.active[0], made.frames.active[every < 20][-1]
    assert not first.any()
    assert last.any()
    blank = policy_rewards.blank(config, setup.make_env(config.env, training=False))
    num = center.shape[2]
    shapes = [x.shape for x in blank.frames if x is not None]
    assert shapes == [(2048, num, 2), (2048, num, 2), (2048, num)]
    assert made.frames.held is blank.frames.held is None  # the task has no `place_held`


def test_a_table_s_frames_say_what_the_hand_holds():
    config = RunConfig(env=EnvConfig(name="umbrella_out"), ppo=PPOConfig(video_state_resets=0.5))
    demos, _ = _films(config, np.array([20, 20]))
    center, size = np.array(demos.center), np.full(demos.center.shape, 0.2, np.float32)
    hand, umbrella = (np.flatnonzero(np.asarray(demos.label[0]) == k)[0] for k in (2, 4))
    way = np.clip(np.arange(20) - 6, 0, 8)[:, None] * np.array([0.0, 0.1])
    center[:, :], center[0, :, hand], center[0, :, umbrella] = 2.0, way, way - 0.1
    demos = demos._replace(
        center=jnp.asarray(center), size=jnp.asarray(size), is_robot=demos.label < 3
    )
    learned = RewardParams({}, jnp.zeros(1), jnp.ones(()), jnp.ones(()))
    frames = policy_rewards.parameters(config, learned, demos, 5).frames
    held = np.asarray(frames.held)
    assert held[512:640, 4].all()
    assert not held[:, :4].any()
    assert not held[1024:].any()
    blank = policy_rewards.blank(config, setup.make_env(config.env, training=False)).frames
    assert jax.tree.map(jnp.shape, blank) == jax.tree.map(jnp.shape, frames)


def test_films_of_other_objects_are_nothing_to_begin_at():
    config = RunConfig(ppo=PPOConfig(video_state_resets=0.5))
    learned = RewardParams({}, jnp.zeros(1), jnp.ones(()), jnp.ones(()))
    demos = kinematic_demos(0, 4, num_objects=4, max_length=20)
    with pytest.raises(DemoError, match="show other objects than the task has: video_state_resets"):
        policy_rewards.parameters(config, learned, demos, 4)


def test_a_task_that_cannot_place_boxes_is_refused_frames_to_begin_at():
    config = RunConfig(ppo=PPOConfig(video_state_resets=0.5))
    with pytest.raises(
        ConfigError, match=r"video_state_resets is 0\.5, but match_regions cannot place"
    ):
        policy_setup.make_algorithm(config, Probe())


def test_stages_end_where_demonstrations_agree_that_the_reward_stands_still(monkeypatch):
    """At three quarters of each step of three, and in episodes the index follows the reward."""
    latents = jnp.asarray(_latents(6)[..., None], jnp.float32)
    monkeypatch.setattr(policy_rewards.pretrain, "embed", lambda *_: latents)
    config = RunConfig(run=dataclasses.replace(RunSettings(), reward="stages"))
    learned = RewardParams({}, jnp.zeros(1), jnp.float32(1 / 3), jnp.float32(1.0))
    demos = kinematic_demos(0, 6, num_objects=4, max_length=20)
    demos = demos._replace(length=jnp.full(6, FRAMES))
    same, stairs = policy_rewards.parameters(config, learned, demos, 4)
    assert same is learned
    assert int(stairs.count) == 3
    np.testing.assert_allclose(stairs.least[:3], [-0.75, -5 / 12, -1 / 12], atol=0.03)
    params = learned, stairs
    assert policy_rewards.stages_of(params) is stairs
    shares = jnp.array([[[0.0], [1 / 3]], [[1.0], [1.0]]])
    assert policy_rewards.stages_finished(params, shares) == [1.0, 0.5, 0.5]
    words = policy_rewards.stages_in_words(params, shares[0])
    assert words == ["stage 1 of 3", "stage 1 of 3", "stage 2 of 3"]
    assert policy_rewards.stages_in_words(params, shares[1])[-1] == "all stages done"


@pytest.mark.parametrize(
    ("count", "sub_policies", "said"),
    [
        (2, 2, None),
        (3, 1, None),
        (1, 2, "a one-stage task: one policy learns it, and 1 of 2 sub-policies"),
        (3, 2, "agree on 3 stages, which 2 sub-policies share out: --ppo.sub-policies 3 gives"),
    ],
)
def test_stages_that_do_not_fit_the_sub_policies_are_said(count, sub_policies, said):
    run, ppo = RunSettings(reward="stages"), PPOConfig(sub_policies=sub_policies)
    stairs = Staircase(jnp.zeros(8), jnp.zeros(8), jnp.int32(count))
    found = policy_rewards.stages_note(RunConfig(run=run, ppo=ppo), (None, stairs))
    assert found is said is None or said in found


def test_rewards_without_stages_have_no_word_of_them():
    for params in ((), RewardParams({}, jnp.zeros(1), jnp.ones(()), jnp.ones(()))):
        assert policy_rewards.stages_of(params) is None
        assert policy_rewards.stages_finished(params, jnp.zeros((2, 3, 0))) == []
        assert policy_rewards.stages_in_words(params, jnp.zeros((3, 0))) == []


ONE_BLOCK = EnvConfig(targets=("green square",), distractors=("yellow circle",))


@pytest.mark.parametrize(("variant", "count"), [("demo", 1), ("jitter", 12), ("layout", 12)])
def test_a_variant_s_starts_are_counted(variant, count):
    env = setup.make_env(ONE_BLOCK, training=False)
    episodes = Episodes.of(env, rewards.environmental)
    group = draw(ONE_BLOCK, variant, episodes, jax.random.key(0), count=12)
    assert group.count == count
    assert len(group.start) == len(group.begun.time) == 12


def test_equal_rows_are_one_start_and_keys_tell_nothing():
    place = np.array([[0.5, 1.0], [0.25, 1.0], [0.5, 1.0], [0.5 + 1e-8, 1.0]], np.float64)
    older = jnp.arange(8, dtype=jnp.uint32).reshape(4, 2)
    states = {"place": place, "key": jax.random.split(jax.random.key(0), 4), "old": older}
    first, second, *others = which(states)
    assert first != second
    assert others == [first, first]
    assert len({*which(states | {"count": jnp.arange(4)}).tolist()}) == 4


def test_each_distinct_start_counts_once():
    group = Group("", None, np.array([0, 1, 0, 0]))
    assert group.share(np.array([1.0, 0.0, 1.0, 1.0, 9.0])) == 0.5


def test_a_task_says_which_variants_stand_for_what():
    def found(variant):
        return tuple(evaluated_from(EnvConfig(variant=variant)))

    assert found("demo") == ("demo", "jitter", "layout")
    assert found("jitter") == ("jitter", "jitter", "layout")
    assert found("layout") == ("layout", "layout", None)
    assert found("shape") == ("shape", "shape", None)
    assert tuple(evaluated_from(EnvConfig(name="shoes_in_box"))) == (None, None, None)
    for name in registry.names():
        task = registry.spec(name)
        assert {*task.many_starts, *task.elsewhere} <= {"demo", "jitter"}
