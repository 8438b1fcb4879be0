"""When a training without a fixed length ends, and which policy it keeps."""

import dataclasses
import itertools
import random
import signal

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gril_jax.envs.user_tasks import files
from support import own_task

from gril_jax.config import EnvConfig
from gril_jax.config.files import load
from gril_jax.config.grid import with_seed
from gril_jax.errors import ConfigError, RunError
from gril_jax.runs import pace, run_dir
from gril_jax.runs.checkpoints.state_leaves import digest
from gril_jax.runs.interrupt import Interrupted
from gril_jax.workflows.build import policy_setup, setup
from gril_jax.workflows.learning import policies, stopping
from gril_jax.workflows.study.recipe import changed


def _watched(success, value=None):
    """Trainings after so many evaluations, (E, S), whose policy is the evaluation's number."""
    success = np.asarray(success, np.float32)
    value = np.zeros_like(success) if value is None else np.asarray(value, np.float32)
    policy = lambda n: {"weights": jnp.full((success.shape[1], 2), n, jnp.float32)}  # noqa: E731
    found = stopping.begin((), policy(-1), evaluations=len(success) + 5, seeds=success.shape[1])
    for number, (one, other) in enumerate(zip(success, value, strict=True)):
        found = stopping.noted(found, one, other, policy(number))
    return found


def _column(*values):
    return np.array(values, np.float32)[:, None]


def test_the_best_policy_of_each_seed_is_kept_though_later_ones_leave_success():
    success = np.stack([[0, 0.2, 0.5, 0.9, 1, 1, 0.8, 0.1], [0, 0, 0, 0, 0.1, 0.2, 0.3, 0.4]], 1)
    found = _watched(success)
    assert found.best["weights"][:, 0].tolist() == [5, 7]
    assert stopping.best_so_far(found).tolist() == [5, 7]


def test_a_single_lucky_evaluation_is_not_the_best():
    found = _watched(_column(0, 0.5, 0.5, 0.9, 0.1, 0.6, 0.7, 0.7, 0.6))
    assert found.best["weights"][0, 0] == 7  # a mean of 0.667 against 0.633


def test_where_success_is_level_the_return_decides():
    zero = _column(*[0] * 6)
    assert _watched(zero, _column(1, 2, 9, 9, 9, 3)).best["weights"][0, 0] == 4


@pytest.mark.parametrize("since", [1, 2, 3, 8])
def test_it_ends_once_a_fifth_has_passed_without_improvement(since):
    rise = np.linspace(0, 0.8, 12)  # the last mean of three is the highest, at evaluation 11
    found = _watched(np.concatenate([rise, np.full(since, 0.6)])[:, None])
    assert stopping.is_over(found) == (12 <= 0.8 * (12 + since))


def test_gains_in_return_alone_keep_it_going_and_tiny_ones_do_not():
    zero = np.zeros((20, 1))
    assert not stopping.is_over(_watched(zero, np.linspace(0, 1, 20)[:, None]))
    risen = np.concatenate([np.linspace(0, 1, 10), 1 + np.linspace(0, 0.01, 10)])
    assert stopping.is_over(_watched(zero, risen[:, None]))


def test_success_ends_it_at_once_and_counts_for_good():
    won = np.concatenate([np.linspace(0, 0.9, 5), [0.99, 0.99, 1.0]])
    climbing = np.linspace(0, 0.7, 8)
    assert stopping.is_over(_watched(won[:, None]))
    assert stopping.is_over(_watched(won[:, None]), early=True)
    assert not stopping.is_over(_watched(np.zeros((20, 1))), early=True)
    assert not stopping.is_over(_watched(np.stack([won, climbing], 1)))
    later = np.concatenate([won, np.linspace(0.9, 0.95, 3)])
    also = np.concatenate([climbing, [1, 1, 1]])
    assert stopping.is_over(_watched(np.stack([later, also], 1)))


@pytest.mark.parametrize("seed", range(3))
def test_noise_alone_neither_ends_a_rise_nor_prolongs_a_plateau_for_long(seed):
    rng = np.random.default_rng(seed)
    rise = np.linspace(0.02, 0.9, 30)
    flat = np.full(60, 0.9)
    drawn = rng.binomial(128, np.concatenate([rise, flat])) / 128
    ends = [n for n in range(3, 90) if stopping.is_over(_watched(drawn[:n, None]))]
    assert 30 <= ends[0] <= 60


def test_before_three_evaluations_it_goes_on_with_the_last_policy():
    found = _watched(_column(1, 0.5))
    assert not stopping.is_over(found)
    assert found.best["weights"][0, 0] == 1


SMALL = """
ppo: {num_envs: 8, unroll_length: 4, num_timesteps: 96, num_minibatches: 2, hidden: [8]}
run: {reward: environmental, evaluations: 3, updates_per_chunk: 1, checkpoint_every: 0}
"""


def _trained(folder, out, *, cut=None, call=None, rates=(3e-4, 3e-4)):
    """A training of two policies without a fixed length, that a signal may cut off after so many
    chunks, or calls."""
    config = load(str(folder / "small.yaml"))
    config = dataclasses.replace(config, env=EnvConfig(name=f"{folder / 'my_task.py'}:make"))
    config = dataclasses.replace(config, run=dataclasses.replace(config.run, max_steps=3200))
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    plan = policies.plan_of(config, algorithm)
    tasks = policies.tasks_to_evaluate(config, algorithm)
    seeds = [
        changed(with_seed(config, seed), {"ppo.learning_rate": rate})
        for seed, rate in enumerate(rates)
    ]
    program = policies.compiled_for(seeds, algorithm, jax.devices(), tasks, plan)

    def row(done, found):
        if done == cut:
            signal.raise_signal(signal.SIGTERM)
        return policies.metrics_of(plan, done, found)

    calls = itertools.count(1)

    def tick(steps):
        if next(calls) == call:
            signal.raise_signal(signal.SIGTERM)

    opened = run_dir.resume(out) if out.exists() else run_dir.create(
        out, config, device="cpu", command=["train"], experiment="train"
    )  # fmt: skip
    with opened as run:
        return policies.train(
            program, (), plan, seeds, name="ppo", run=run, echo=print, row=row,
            tick=tick,
        )  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """A folder with a task and its configuration."""
    own_task.write(tmp_path, name="my_task.py", rewarded=(
        'metrics={"success": (jnp.abs(puck) < 0.3).all()})',
        'reward=-jnp.abs(puck).sum(), metrics={"success": jnp.array(False)})',
    ))  # fmt: skip
    (tmp_path / "small.yaml").write_text(SMALL)
    files.name(str(tmp_path / "my_task.py"))
    return tmp_path


def test_a_training_that_is_cut_off_comes_to_the_same_end_and_policy(folder, monkeypatch):
    tmp_path = folder
    whole = _trained(tmp_path, tmp_path / "whole")
    assert 96 < whole.env_steps < 3200  # neither at once nor at the most
    assert all(96 <= kept <= whole.env_steps for kept in whole.kept)
    draw = random.Random(0)
    monkeypatch.setattr(pace, "CALL_S", 0.0)  # each call makes one move
    for cut in (2, whole.env_steps // 32 - 1):
        with pytest.raises(Interrupted):
            _trained(tmp_path, tmp_path / f"cut {cut}", cut=cut)
        with pytest.raises(Interrupted):
            _trained(tmp_path, tmp_path / f"cut {cut}", call=draw.randrange(1, 3))
        again = _trained(tmp_path, tmp_path / f"cut {cut}")
        assert (again.env_steps, again.kept) == (whole.env_steps, whole.kept)
        assert digest((again.policy, again.state)) == digest((whole.policy, whole.state))
        rows = [run_dir.read_metrics(tmp_path / name) for name in ("whole", f"cut {cut}")]
        assert rows[0] == rows[1]
    finished = _trained(tmp_path, tmp_path / "whole")  # nothing is left to be done
    assert digest(finished.policy) == digest(whole.policy)


def test_where_one_of_two_policies_diverges_the_other_comes_to_what_it_would(folder):
    whole = _trained(folder, folder / "whole")
    found = _trained(folder, folder / "one", rates=(3e-4, 1e30))
    assert [*found.diverged] == [1]
    assert "at env step" in found.diverged[1]
    first = [jax.tree.map(lambda x: x[0], one.policy) for one in (whole, found)]
    assert found.env_steps >= whole.env_steps or digest(first[0]) == digest(first[1])
    with pytest.raises(RunError, match="the other 1 failed, too"):
        _trained(folder, folder / "none", rates=(1e30, 1e30))
    assert not [*(folder / "none").glob("checkpoints/ppo/0*")]  # none would be finite


@pytest.mark.parametrize("given", [("--run.evaluations", "0"), ("--max-steps", "None")])
def test_without_evaluations_or_a_maximum_the_length_is_fixed(given):
    config = load("own_task", given)
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    plan = policies.plan_of(config, algorithm)
    assert (plan.least, plan.updates) == (None, -(-config.ppo.num_timesteps // plan.steps))


def test_environments_that_cannot_be_halved_play_no_evaluations():
    odd = ("--ppo.num-envs", "255", "--ppo.num-minibatches", "5")
    config = load("own_task", odd)
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    with pytest.raises(ConfigError, match="num_envs is 255, but must be even: half of"):
        policies.plan_of(config, algorithm)
    without = load("own_task", (*odd, "--run.evaluations", "0"))
    assert policies.plan_of(without, algorithm).evaluations == 0


def test_a_smaller_maximum_is_the_length_and_evaluations_keep_their_distance():
    config = load("own_task", ("--max-steps", "1000000"))
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    plan = policies.plan_of(config, algorithm)
    assert (plan.updates, plan.least, plan.evaluations) == (66, 66, 5)
    plan = policies.plan_of(load("own_task"), algorithm)
    assert (plan.updates, plan.least, plan.evaluations) == (1303, 1042, 100)
    assert plan.evaluated_at(0) == 16 * 15360  # the fourth chunk of 4 updates
