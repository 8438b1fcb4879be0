"""A policy that acts in a loop of one's own does as it does in training's episodes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support import own_task
from support.probes import Probe

import gril_jax as gril
from gril_jax.api.actor import Actor
from gril_jax.errors import RunError, ShapeError
from gril_jax.rl.policy import Policy
from gril_jax.rl.ppo import PPO, Static
from gril_jax.rl.rewards import Reward, shaped

PLAIN = {"run": {"reward": "learned"}, "ppo": {"sub_policies": 1}}
STAGED = {"run": {"reward": "stages"}, "ppo": {"sub_policies": 2, "observe_gradient": True}}

# A gradient is a small difference of latents, in units of the longest: programs round it
# differently.
ROUNDING = {"learned": 1e-6, "stages": 1e-4}


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("home")
    own_task.write(folder)
    own_task.demonstrations(folder / "set")
    return folder


@pytest.fixture(scope="module", params=[PLAIN, STAGED], ids=["plain", "stages and gradient"])
def policy(request, home):
    demos = gril.load_demos(home / "set")
    task = gril.make(f"{home / 'my_task.py'}:make")
    options = {"preset": str(home / "small.yaml"), "progress": False}
    reward = gril.learn_reward(demos, task=task, **options)
    return gril.train_policy(task, reward, demos=demos, **options, **request.param)


def _episode(policy, steps=7):
    """Observations, boxes, inputs of the network and actions along an episode of training's."""
    episodes, key = policy.algorithm.episodes, jax.random.key(1)
    params, reward = (
        jax.tree.map(lambda x: x[0], tree) for tree in (policy.parameters, policy.reward_parameters)
    )

    def move(episode, _):
        action = policy.algorithm.act(params, episode, key, deterministic=True)
        seen = episode.state.obs, *episode.state.objects[:2], episodes.observe(episode), action
        moved, _ = episodes.advance(reward, episode, action, tau=policy.config.pool.tau)
        return moved, seen

    return jax.jit(lambda: jax.lax.scan(move, episodes.begin(key), length=steps)[1])()


def _acted(actor, obs, center, size):
    """Actions on the same observations and boxes."""

    def move(seen, now):
        obs, center, size = now
        action = actor.act(seen, obs)
        return actor.see(seen, center, size), action

    after = (jnp.roll(x, -1, axis=0) for x in (center, size))  # boxes after each step
    return jax.lax.scan(move, actor.begin(center[0]), (obs, *after))[1]


def test_an_actor_does_as_the_policy_does_in_training(policy):
    obs, center, size, _, action = _episode(policy)
    ours = jax.jit(lambda *x: _acted(policy.actor(), *x))(obs, center, size)
    atol = ROUNDING[policy.config.run.reward]
    np.testing.assert_allclose(ours, action, atol=atol)
    assert np.ptp(np.asarray(action), axis=0).max() > 1e-3
    many = jax.vmap(lambda *x: _acted(policy.actor(), *x))(*(x[None] for x in (obs, center, size)))
    np.testing.assert_allclose(many[0], ours, atol=atol)


def test_step_by_step_it_is_the_same_without_jit(policy):
    obs, center, size, _, action = _episode(policy, steps=3)
    actor, atol = policy.actor(), ROUNDING[policy.config.run.reward]
    seen = actor.begin(center[0])
    for i in range(2):
        np.testing.assert_allclose(actor.act(seen, obs[i]), action[i], atol=atol)
        seen = actor.see(seen, center[i + 1], size[i + 1])


def test_the_input_of_the_network_ends_with_gradients_and_the_share_of_stages_done(policy):
    obs, center, size, seen, _ = _episode(policy)
    actor, observe = policy.actor(), policy.algorithm.episodes.reward.observe
    memory = actor.begin(center[0])
    staged = policy.config.run.reward == "stages"
    assert observe(memory.remembered).shape == (staged * (2 * 3 + 1),)  # three objects
    for i in range(len(obs) - 1):
        ours = jnp.concatenate([obs[i], memory.memory.active, observe(memory.remembered)])
        np.testing.assert_allclose(ours, seen[i], atol=ROUNDING[policy.config.run.reward])
        memory = actor.see(memory, center[i + 1], size[i + 1])


def _probe(reward):
    """An actor of the probe, of which only the memory is looked at."""
    sizes = Static(num_envs=2, num_minibatches=1, window=4)
    objects = Probe().reset(jax.random.key(0)).objects
    unused = Policy(None, None)
    return Actor(PPO(Probe(), reward, sizes), unused, None, objects, 2, 0.005), objects


def test_a_reward_sees_the_labels_that_the_episode_began_with():
    seen_labels = Reward(
        init=lambda: jnp.zeros(3),
        step=lambda params, memory, state, active: (state.objects.label * 1.0, 0.0),
        observe=lambda memory: memory,
    )
    actor, objects = _probe(seen_labels)
    for label in (None, jnp.array([2, 0, 1])):
        seen = actor.see(actor.begin(objects.center, label), objects.center, objects.size)
        np.testing.assert_array_equal(seen.remembered, objects.label if label is None else label)


def test_a_memory_that_the_policy_does_not_see_is_not_computed():
    actor, objects = _probe(shaped(lambda params, state, active: state.objects.center.sum()))
    seen = actor.see(actor.begin(objects.center), objects.center + 1.0, objects.size)
    assert seen.memory.active.all()
    assert seen.remembered == -1.0


def test_boxes_and_observations_of_another_scene_are_told_so(policy):
    actor = policy.actor()
    with pytest.raises(ShapeError, match=r"center has shape \(2, 2\), but .* has \(3, 2\)"):
        actor.begin(jnp.zeros((2, 2)))
    with pytest.raises(ShapeError, match=r"observation has shape \(5,\), but .* has \(2,\)"):
        actor.act(actor.begin(jnp.zeros((3, 2))), jnp.zeros(5))


def test_a_folder_without_a_run_is_told_so(tmp_path):
    with pytest.raises(RunError, match="config"):
        gril.load_policy(tmp_path)
