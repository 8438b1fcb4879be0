"""A chunk of training for both algorithms, and what its evaluation says and leaves alone."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.probes import Probe

from gril_jax.config import RunConfig, RunSettings
from gril_jax.rl import ppo, rewards, sac, training
from gril_jax.rl.evaluate import begin, evaluate
from gril_jax.workflows.build import policy_setup

NUM, UPDATES = 8, 3
SMALL = {"num_envs": NUM, "unroll_length": 3, "hidden": (8,), "window": 4}  # of episodes of 8


class Steady(Probe):
    """Nothing is random but the policy: the sign is 1, and success is what the start says.

    The score is where the block has been moved to.
    """

    def _sign(self, key):
        return jnp.float32(1)

    def _state(self, data, reward, fits):
        state = super()._state(data, reward, fits)
        return state._replace(metrics={"score": data.where[0], "success": data.heat})


EXAMS = (Steady(), Steady(fragile=1.0))


def _make(name):
    if name == "ppo":
        return ppo.PPO(Steady(), rewards.environmental, ppo.Static(num_minibatches=2, **SMALL))
    sizes = {"updates_per_step": 2, "batch_size": 8, "replay_size": 24 * 4000, "min_replay": 24}
    return sac.SAC(Steady(), rewards.environmental, sac.Static(**sizes, **SMALL))


HYPER = {
    "ppo": ppo.Hyper(*map(jnp.float32, ppo.Hyper())),
    "sac": sac.Hyper(*map(jnp.float32, sac.Hyper())),
}


def _numbers(tree):
    def plain(leaf):
        key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
        return np.asarray(jax.random.key_data(leaf) if key else leaf)

    return jax.tree.map(plain, tree)


@pytest.fixture(scope="module", params=["ppo", "sac"])
def name(request):
    return request.param


@pytest.fixture(scope="module")
def algorithm(name):
    return _make(name)


@pytest.fixture(scope="module")
def start(algorithm, name):
    """A compiled `init`; a chunk takes its state over."""
    return jax.jit(lambda key: algorithm.init(key, HYPER[name]))


def _compile(algorithm, name, state, evaluation=EXAMS):
    def run(state):
        return training.chunk(
            algorithm, state, HYPER[name], None, updates=UPDATES, evaluation=evaluation
        )

    return jax.jit(run, donate_argnums=0).lower(state).compile()


@pytest.fixture(scope="module")
def examined(algorithm, name, start):
    return _compile(algorithm, name, start(jax.random.key(0)))


@pytest.fixture(scope="module")
def result(examined, start):
    return examined(start(jax.random.key(0)))


def test_both_algorithms_keep_the_protocol(algorithm):
    assert isinstance(algorithm, training.Algorithm)


def test_an_evaluation_takes_no_key_no_start_and_no_replay_from_training(algorithm, start, result):
    key = start(jax.random.key(0)).key
    for _ in range(UPDATES):
        key = jax.random.split(key, 3)[0]
    state = result[0]
    np.testing.assert_array_equal(jax.random.key_data(state.key), jax.random.key_data(key))
    assert int(state.updates) == int(state.envs.drawn) == UPDATES
    if state.replay:
        assert int(state.replay.size) == UPDATES * NUM * algorithm.unroll_length


@pytest.mark.slow
def test_an_evaluation_changes_nothing_of_training(algorithm, name, start, result):
    """Another program rounds otherwise; keys and counters are equal to the bit."""
    state = start(jax.random.key(0))
    state, metrics, none = _compile(algorithm, name, state, ())(state)
    assert none is None
    plain, beside = _numbers((state, metrics)), _numbers(result[:2])
    chex.assert_trees_all_close(plain, beside, rtol=1e-5, atol=1e-6)
    exact = [x for x in jax.tree.leaves((plain, beside)) if x.dtype.kind != "f"]
    for one, other in zip(exact[: len(exact) // 2], exact[len(exact) // 2 :], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_compiled_chunk_takes_what_it_returned(examined, start, result):
    """No second trace: types and shapes stay. Metrics are one row an update."""
    state, metrics, _ = examined(examined(start(jax.random.key(0)))[0])
    assert int(state.updates) == 2 * UPDATES
    assert all(x.shape == (UPDATES,) for x in metrics.values())
    assert set(metrics) == set(result[1])
    chex.assert_tree_all_finite(metrics)


def test_the_state_is_changed_in_place(examined, result):
    """Beside the donated state, a replay above all, the program needs little memory."""
    size = sum(x.nbytes for x in jax.tree.leaves(_numbers(result[0])))
    memory = examined.memory_analysis()
    assert memory.alias_size_in_bytes >= 0.99 * size
    if jax.tree.leaves(result[0].replay):
        assert memory.temp_size_in_bytes < 0.2 * size


def test_mean_actions_score_as_in_an_evaluation_of_the_policy(algorithm, result):
    """Whole episodes, though the unroll does not divide them; samples score otherwise."""
    state, _, scores = result
    policy = algorithm.policy(state)
    begun = begin(algorithm.episodes, jax.random.key(5), episodes=2)
    alone = evaluate(algorithm, policy, None, begun, jax.random.key(6), tau=0.005)
    assert scores.score.shape == (2, 2)
    np.testing.assert_allclose(scores.score[:, 0], alone.score.mean(), rtol=1e-4)
    np.testing.assert_allclose(scores.reward[:, 0], alone.reward.sum(1).mean(), rtol=1e-4)
    assert np.abs(scores.score[:, 1] - scores.score[:, 0]).min() > 1e-3


def test_variants_are_told_apart(result):
    """The second succeeds whatever is done, and the first never."""
    scores = result[2]
    np.testing.assert_array_equal(scores.success, [[0, 0], [1, 1]])
    np.testing.assert_array_equal(scores.success_ever, [[0, 0], [1, 1]])


@pytest.mark.slow
def test_seeds_side_by_side_equal_seeds_one_by_one(algorithm, name, examined, start):
    """Every leaf: weights, replay, fleet, metrics and the evaluation; and no copy of the replay."""

    def run(state):
        return training.chunk(
            algorithm, state, HYPER[name], None, updates=UPDATES, evaluation=EXAMS
        )

    keys = jax.random.split(jax.random.key(3), 2)
    begun = jax.vmap(start)(keys)
    compiled = jax.jit(jax.vmap(run), donate_argnums=0).lower(begun).compile()
    if name == "sac":
        size = sum(x.nbytes for x in jax.tree.leaves(begun.replay))
        assert compiled.memory_analysis().temp_size_in_bytes < 0.2 * size
    both = compiled(begun)
    for i, key in enumerate(keys):
        beside = jax.tree.map(lambda x, i=i: x[i], both)
        chex.assert_trees_all_close(
            _numbers(beside), _numbers(examined(start(key))), atol=1e-4, rtol=1e-4
        )


@dataclasses.dataclass(frozen=True)
class Chosen(RunSettings):
    """Settings of a run that name its algorithm."""

    algorithm: str = "ppo"


@pytest.mark.parametrize(("name", "kind"), [("ppo", ppo), ("sac", sac)])
def test_the_configuration_chooses_the_algorithm(name, kind):
    config = RunConfig(run=Chosen(algorithm=name))
    made = policy_setup.make_algorithm(config, Steady())
    assert isinstance(made, ppo.PPO if name == "ppo" else sac.SAC)
    assert isinstance(policy_setup.algorithm_hyper(config), kind.Hyper)
    assert made.num_envs == getattr(config, name).num_envs


@pytest.mark.parametrize("name", ["ppo", "sac"])
def test_no_key_of_a_step_is_used_twice_nor_in_the_evaluation_before_it(name):
    """And an evaluation's keys take none away from the step."""
    algorithm, key = _make(name), jax.random.key(3)
    step = jax.random.split(key, algorithm.num_keys)
    every = jax.random.key_data(jax.random.split(key, algorithm.num_keys + NUM + 1))
    np.testing.assert_array_equal(jax.random.key_data(step), every[: algorithm.num_keys])
    assert len(np.unique(every, axis=0)) == len(every)
    halves = jax.random.key_data(jnp.concatenate(algorithm._split(key)))
    np.testing.assert_array_equal(halves, jax.random.key_data(step[1:]))
    np.testing.assert_array_equal(
        jax.random.key_data(training._next(algorithm, key)), jax.random.key_data(step[0])
    )
