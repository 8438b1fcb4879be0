"""A study's shares of environments and policies, and how rows share programs and rewards."""

from pathlib import Path

import jax
import numpy as np
import pytest

from gril_jax.config import EnvConfig, RunConfig
from gril_jax.config.files import load
from gril_jax.errors import RunError
from gril_jax.rl.training import Scores
from gril_jax.workflows.study import audit, driver, programs, recipe, rewards
from gril_jax.workflows.study.programs import Counted, Program
from gril_jax.workflows.study.recipe import changed
from gril_jax.workflows.study.saved import Row, learns


@pytest.mark.parametrize(
    ("starts", "num_envs", "parts"),
    [(1, 2, 1), (1, 3, 0), (3, 6, 3), (3, 4096, 4), (3, 8, 4), (3, 20, 5), (3, 4, 0), (2, 4, 2)],
)
def test_parts_are_at_least_the_starts_and_twice_their_number_divides_the_environments(
    starts, num_envs, parts
):
    assert programs._num_parts(starts, num_envs) == parts


def test_policies_wait_for_the_rewards_that_they_are_trained_on_and_for_no_others():
    kinds = [
        {"run.reward": "learned"},
        {"run.reward": "environmental"},
        {"run.reward": "shaped", "loss.near_cost_fraction": 0.7},
    ]
    rows = [Row(i, 0, changed(RunConfig(), change)) for i, change in enumerate(kinds)]
    wanted = [
        rewards.Wanted(
            f"reward-{i}", [rewards.reward_key(row.config)], [row.config], [row], None, None
        )
        for i, row in enumerate((rows[0], rows[2]))
    ]
    assert [rewards.needed(wanted, [row]) for row in rows] == [{"reward-0"}, set(), {"reward-1"}]


def test_rewards_of_other_offsets_are_other_programs():
    rows = [
        Row(i, 0, changed(RunConfig(), {"run.reward_offset": by, "ppo.num_envs": 4}))
        for i, by in enumerate((0.0, 1.0, 1.0))
    ]
    found = programs.programs(rows, 7, jax.devices())
    assert [[row.cell for row in program.rows] for program in found] == [[0], [1, 2]]


def test_rows_whose_rewards_have_other_parameters_share_no_program():
    names = ("tcc", "tcc_huber", "rewind", "sarm", "rewind")
    plain = {"ppo.num_envs": 4, "loss.warmup": 0}
    rows = [
        Row(i, 0, changed(RunConfig(), plain | {"loss.consistency": name}))
        for i, name in enumerate(names)
    ]
    found = programs.programs(rows, 7, jax.devices())
    assert [[row.cell for row in program.rows] for program in found] == [[0, 1], [2, 4], [3]]
    measure = audit.Audit(lambda _: None, ascents=1)
    same = [measure.same(row.config) for row in rows]
    assert [same.index(one) for one in same] == [0, 0, 2, 3, 2]


def test_a_reward_that_could_not_be_learned_loses_its_own_policy_alone():
    kinds = [{"pretrain.steps": 5}, {"pretrain.steps": 6}, {"run.reward": "environmental"}]
    configs = [changed(RunConfig(), {"run.reward": "learned"} | kind) for kind in kinds]
    one = rewards.TrainedReward(None, 0.5, None, 7)
    known = {rewards.reward_key(configs[1]): one}
    found, wrong = programs._rewards_of(configs, known)
    assert found == [one, one, None]
    assert wrong == {0: "its reward could not be learned"}
    with pytest.raises(RunError, match="none of its rewards could be learned"):
        programs._rewards_of(configs, {})


def test_a_finished_program_must_have_the_same_policies():
    finished = {"policy-0": {"rows": [[0, 0], [0, 1]]}}.get
    first, second = (
        Program(f"policy-{i}", [Row(0, seed, RunConfig()) for seed in seeds], None, {}, None)
        for i, seeds in enumerate(((0, 1), (2, 3)))
    )
    driver._require_same_parts(Path("run"), finished, [first, second])
    with pytest.raises(RunError, match="policy-0 has finished with 2 policies, but would have 1"):
        driver._require_same_parts(Path("run"), finished, [first._replace(rows=first.rows[:1])])


def test_a_program_has_at_most_so_many_policies():
    for count, most, parts in ((7, 3, [3, 3, 1]), (2, 3, [2]), (7, None, [7])):
        rows = [Row(0, seed, RunConfig()) for seed in range(count)]
        found = programs._evenly(rows, most)
        assert [len(part) for part in found] == parts
        assert [row for part in found for row in part] == rows


def test_rows_that_differ_in_what_becomes_of_their_reward_share_it():
    names = ["ours audited", "ours with potential shaping", "ours with robot"]
    base, rows = load("match_regions"), recipe.load("table1").rows
    keys = [rewards.reward_key(changed(base, rows[name])) for name in names]
    assert keys[0] == keys[1] != keys[2]
    assert not learns(changed(base, rows["environmental"]))


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (("demo", "jitter"), {"demo": Counted(3, 1), "jitter": Counted(3, 3)}),
        (("jitter",), {"jitter": Counted(6, 6)}),
    ],
)
def test_a_program_s_starts_are_drawn_and_counted_for_each_half_of_its_share(names, found):
    env = EnvConfig(targets=("green square",), distractors=("yellow circle",))
    row = Row(0, 0, RunConfig(env=env))
    algorithm = type("Algorithm", (), {"num_envs": 12})
    program = Program("policy-0", [row], algorithm, dict.fromkeys(names), None)
    assert programs.starts(program) == found


def test_environments_that_are_left_go_to_the_variant_with_many_starts():
    algorithm = type("Algorithm", (), {"num_envs": 16})
    tasks = dict.fromkeys(("demo", "jitter", "layout"))
    program = Program("policy-0", [], algorithm, tasks, None)
    assert programs._tasks_of_parts(program) == ["demo", "jitter", "jitter", "layout"]


def test_scores_have_the_names_of_their_starts_and_parts_of_one_start_are_averaged():
    values = np.random.default_rng(0).uniform(size=(4, 5, 3, 2))  # score, policy, part, actions
    found = programs._by_start(["demo", "layout", "layout"], Scores(*values))
    for name, of in zip(Scores._fields, values, strict=True):
        np.testing.assert_allclose(found[name], of[:, 0, 0])
        np.testing.assert_allclose(found[f"{name}_sampled"], of[:, 0, 1])
        layout = (of[:, 1] + of[:, 2]) / 2
        np.testing.assert_allclose(found[f"{name}_layout"], layout[:, 0])
        np.testing.assert_allclose(found[f"{name}_layout_sampled"], layout[:, 1])
    assert len(found) == 16
