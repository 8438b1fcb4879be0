"""The benchmarks of training, at sizes that say nothing but that they work."""

import jax
import pytest
from gril_jax.experiments.bench import compile as bench_compile
from gril_jax.experiments.bench import sac as bench_sac
from gril_jax.experiments.bench import seeds
from gril_jax.experiments.bench import train as bench_train
from support.probes import Probe

from gril_jax.cli import main
from gril_jax.errors import ConfigError
from gril_jax.rl import ppo, rewards, sac

SIZES = bench_train.Sizes(
    num_envs=8, unroll=2, hidden=(4,), width=4, seed_num_envs=4, seed_updates=1, num_seeds=2
)
TINY = sac.Static(
    num_envs=4, unroll_length=2, updates_per_step=1, batch_size=4, replay_size=64, min_replay=8,
    hidden=(4,), window=2,
)  # fmt: skip


class Success(Probe):
    """A probe that is named as the summary of training wants it, in short episodes."""

    def __init__(self):
        super().__init__(episode_length=4)


def test_the_loop_on_the_host_learns_from_what_it_has_stored():
    loop = bench_sac.HostLoop(Success(), TINY, sac.Hyper(), steps=16)
    before = jax.device_get(loop._learned.params.policy)
    loop.advance()
    assert loop.steps == 16
    after = jax.device_get(loop._learned.params.policy)
    assert any((a != b).any() for a, b in zip(*map(jax.tree.leaves, (before, after)), strict=True))
    stored = loop._replay
    assert (stored["next_observation"][:15] == stored["observation"][1:16]).all(1).sum() == 12
    assert not stored["action"][16:].any()
    assert len(loop._recent) == 4  # episodes of 4 steps
    assert loop.success == 0.0  # too few to say


def test_a_program_has_times_of_tracing_and_of_compiling():
    times = bench_compile.timed(bench_compile.Program("f", jax.jit(lambda x: x + 1), (1.0,), {}))
    assert set(times) == {"trace_s", "compile_s"}


def test_small_runs_are_processes_that_count_what_they_compile():
    found = bench_compile.small_runs(["--help"])  # nothing, then
    assert {name: (one["programs"], one["compiled"]) for name, one in found.items()} == {
        "cold": (0, 0),
        "warm": (0, 0),
    }


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


def test_sizes_that_do_not_fit_are_refused_before_anything_is_compiled():
    with pytest.raises(ConfigError, match="replay_size is 131072"):
        bench_sac.main(num_envs=3, target=None)


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


@pytest.mark.slow
def test_the_benchmark_of_sac_compares_both_and_stops_in_time():
    found = bench_sac.speeds(Success(), TINY, sac.Hyper(), 1)
    assert set(found["steps_per_s"]) == {"ours", "host_loop"}
    until = bench_sac.until_success(Success(), TINY, sac.Hyper(), 2.0, 0.1)
    assert not until["ours"]["reached"]
    assert until["host_loop"]["steps"] % 320 == 0
    assert until["host_loop"]["seconds"] < 60
