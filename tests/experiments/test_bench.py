"""The benchmarks: their frame, and each at sizes that say nothing but that it works."""

import gril_jax.experiments.bench.losses as bench
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.experiments.bench import env as bench_env
from gril_jax.experiments.bench import frame
from gril_jax.experiments.bench import train as bench_train
from support.probes import Probe

from gril_jax.cli import main
from gril_jax.rl import ppo, rewards

SIZES = bench_train.Sizes(
    num_envs=8, unroll=2, hidden=(4,), width=4, seed_num_envs=4, seed_updates=1, num_seeds=2
)


class Success(Probe):
    """A probe that is named as the summary of training wants it, in short episodes."""

    def __init__(self):
        super().__init__(episode_length=4)


@pytest.mark.parametrize(
    ("args", "fault"),
    [
        (["train", "--repeats", "0"], "--repeats is 0, but must be at least 1"),
        (["train", "--num-envs=0"], "--num-envs is 0, but must be at least 1"),
        (["train", "--parts", "lunch"], "--parts is 'lunch', but must be one of training, seeds"),
        (["env", "--task", "lunch"], "there is no configuration 'lunch'"),
        (["brax"], "there is no verb 'bench brax'"),
    ],
)
def test_options_of_the_verbs_have_ranges(capsys, args, fault):
    assert main.main(["bench", *args]) == 2
    assert fault in capsys.readouterr().err


@pytest.mark.slow
def test_training_is_compared_with_random_actions(monkeypatch):
    monkeypatch.setattr(rewards, "learned", lambda config, robots: rewards.environmental)
    found = bench_train.costs(Success(), SIZES, 1)
    assert set(found["steps_per_s"]) == {"learned", "environmental", "random"}
    assert set(found["share_of_random"]) == {"learned", "environmental"}


@pytest.mark.slow
def test_separate_seeds_are_counted_as_often_as_there_are_seeds():
    small = ppo.Static(num_envs=4, unroll_length=2, num_minibatches=2, hidden=(4,), window=2)
    algorithm = ppo.PPO(Success(), rewards.environmental, small)
    found = bench_train.seeds(algorithm, 2, 1, 1)
    assert found["steps_of_a_seed"] == 8
    assert found["one_by_one"] == "1 measured, times 2"
    assert found["times_as_fast"] > 0


# --- The frame of the benchmarks


def test_calls_take_turns_and_the_first_of_each_is_left_out():
    order = []
    calls = {"a": lambda: order.append("a"), "b": lambda: order.append("b")}
    taken = frame.times_in_turn(calls, 2)
    assert order == ["a", "b"] * 3
    assert [len(times) for times in taken.values()] == [2, 2]


def test_a_program_is_compiled_before_its_first_call():
    call, seconds = frame.compile_timed(lambda x: x + 1, jnp.ones(2))
    np.testing.assert_array_equal(call(jnp.ones(2)), [2, 2])
    assert seconds > 0


def test_the_cache_is_as_it_was_after_it_has_been_off():
    before = jax.config.jax_enable_compilation_cache
    with frame.without_cache():
        assert not jax.config.jax_enable_compilation_cache
    assert jax.config.jax_enable_compilation_cache == before


# --- The benchmark of the tasks counts episodes whose numbers are finite


def test_an_episode_with_a_number_that_is_not_finite_does_not_count():
    states = {"x": jnp.ones((4, 3)).at[1, 2].set(jnp.nan), "n": jnp.arange(4)}
    assert bench_env._finite(states) == 0.75
    assert bench_env._finite(states | {"y": jnp.ones(4).at[3].set(jnp.inf)}) == 0.5


# --- The benchmark of losses: figures of each side, and the names of peers that are missing


def test_peers_that_are_not_installed_are_named(monkeypatch, capsys):
    monkeypatch.setattr(bench, "ott_costs", None)
    monkeypatch.setattr(bench, "_COMPILATIONS", 1)
    monkeypatch.setattr(bench, "_SIZE", (2, 4, 3))
    found = bench.main([(2, 8)], repeats=1)
    assert found["not_installed"] == ["ott-jax"]
    (case,) = found["soft_dtw"]
    assert case["ms"]["ours"] > 0
    values = [found["tcc"][name]["value"] for name in ("pair_loop", "mapped")]
    assert values == pytest.approx([values[0]] * 2, rel=1e-4)
    assert "losses" in capsys.readouterr().err
