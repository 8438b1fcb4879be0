"""A table's shares of environments and updates, and the programs that it compiles ahead."""

import functools
from concurrent.futures import Future

import jax
import pytest

from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.workflows.study import programs as table_programs
from gril_jax.workflows.study import recipe
from gril_jax.workflows.study import rewards as table_rewards
from gril_jax.workflows.study.rows import Row, changed, learns


@pytest.mark.parametrize(
    ("starts", "num_envs", "parts"),
    [(1, 2, 1), (1, 3, 0), (3, 6, 3), (3, 4096, 4), (3, 8, 4), (3, 20, 5), (3, 4, 0), (2, 4, 2)],
)
def test_parts_are_at_least_the_starts_and_twice_their_number_divides_the_environments(
    starts, num_envs, parts
):
    assert table_programs._num_parts(starts, num_envs) == parts


def test_policies_wait_for_the_rewards_that_they_are_trained_on_and_for_no_others():
    kinds = [
        {"run.reward": "learned"},
        {"run.reward": "environmental"},
        {"run.reward": "shaped", "loss.near_cost_fraction": 0.7},
    ]
    rows = [Row(i, 0, changed(RunConfig(), change)) for i, change in enumerate(kinds)]
    left = [
        table_programs.Program(f"policy-{i}", [row], None, {}, None) for i, row in enumerate(rows)
    ]
    wanted = [
        table_rewards.Wanted([table_rewards.reward_key(row.config)], row.config, None, Future())
        for row in (rows[0], rows[2])
    ]
    ready = {program.name: Future() for program in left}
    trained = []
    tasks = table_programs.tasks(
        left,
        dict(ready),
        functools.partial(table_rewards.needed, wanted),
        lambda program, compiled: trained.append((program.name, compiled)),
    )
    names = ["policy-0", "policy-1", "policy-2"]
    assert [(task.name, task.wanted) for task in tasks] == [(name, ready[name]) for name in names]
    assert [set(task.needs) for task in tasks] == [{"reward-0"}, set(), {"reward-1"}]
    ready["policy-2"].set_result("compiled")
    tasks[2].do()
    assert trained == [("policy-2", "compiled")]


def test_rewards_of_other_offsets_are_other_programs():
    rows = [
        Row(i, 0, changed(RunConfig(), {"run.reward_offset": by, "ppo.num_envs": 4}))
        for i, by in enumerate((0.0, 1.0, 1.0))
    ]
    found = table_programs.programs(rows, 7, jax.devices())
    assert [[row.cell for row in program.rows] for program in found] == [[0], [1, 2]]


def test_a_program_has_at_most_so_many_policies():
    for count, most, parts in ((7, 3, [3, 3, 1]), (2, 3, [2]), (7, None, [7])):
        rows = [Row(0, seed, RunConfig()) for seed in range(count)]
        found = table_programs._evenly(rows, most)
        assert [len(part) for part in found] == parts
        assert [row for part in found for row in part] == rows


def test_rows_that_differ_in_what_becomes_of_their_reward_share_it():
    names = ["ours audited", "ours with potential shaping", "ours with robot"]
    base, rows = load("match_regions"), recipe.load("table1").rows
    keys = [table_rewards.reward_key(changed(base, rows[name])) for name in names]
    assert keys[0] == keys[1] != keys[2]
    assert not learns(changed(base, rows["environmental"]))
