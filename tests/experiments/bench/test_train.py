"""The benchmarks of training, at sizes that say nothing but that they work."""

import pytest
from gril_jax.experiments.bench import seeds
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
        (["train", "--parts", "lunch"], "--parts is 'lunch', but must be one of training, starts"),
        (["env", "--task", "lunch"], "there is no configuration 'lunch'"),
        (["brax"], "there is no verb 'bench brax'"),
    ],
)
def test_options_of_the_verbs_have_ranges(capsys, args, fault):
    assert main.main(["bench", *args]) == 2
    assert fault in capsys.readouterr().err


@pytest.mark.slow
def test_training_is_compared_with_random_actions_and_starts_with_each_other(monkeypatch):
    monkeypatch.setattr(rewards, "learned", lambda config, robots: rewards.environmental)
    found = bench_train.costs(Success(), SIZES, 1)
    assert set(found["steps_per_s"]) == {"learned", "environmental", "random"}
    assert set(found["share_of_random"]) == {"learned", "environmental"}
    found = bench_train.starts(Success(), 8, 2, 1)
    assert found["pool_times_as_fast"]["pool"] == 1
    assert found["starts_an_unroll"] == {"pool": 4, "each_step": 16}


@pytest.mark.slow
def test_separate_seeds_are_counted_as_often_as_there_are_seeds():
    small = ppo.Static(num_envs=4, unroll_length=2, num_minibatches=2, hidden=(4,), window=2)
    algorithm = ppo.PPO(Success(), rewards.environmental, small)
    found = seeds.seeds(algorithm, 2, 1, 1)
    assert found["steps_of_a_seed"] == 8
    assert found["one_by_one"] == "1 measured, times 2"
    assert found["times_as_fast"] > 0
