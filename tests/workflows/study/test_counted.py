"""What a table's success counts: starts that are recorded, and policies as observations."""

import numpy as np
import pytest

from gril_jax.config import EnvConfig, RunConfig
from gril_jax.workflows.study import programs as table_programs
from gril_jax.workflows.study.counted import Counted, of_lines, read, solved
from gril_jax.workflows.study.programs import Program
from gril_jax.workflows.study.rows import Row


def _lines(**more):
    return [{"row": "a", "seed": k, "success": x} | more for k, x in enumerate((1.0, 0.0, 1.0))]


def test_what_lines_count_is_that_of_all_of_them():
    assert of_lines(_lines(starts=8, episodes=8)) == "8 starts"
    assert of_lines(_lines(starts=8) + _lines(starts=16)) == "8 to 16 starts"
    assert of_lines(_lines(starts=8) + _lines()) == "number of starts not recorded"
    assert of_lines([]) == "number of starts not recorded"


def test_of_a_single_start_it_is_told_who_solves_it():
    assert solved(np.array([0.999, 1.0]), 2) == "solved by 1 of 2 policies"  # not in each of many
    assert of_lines(_lines(starts=1, episodes=8), "demo") == "one Demo start"


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
    assert table_programs.starts(program) == found
    assert read({"starts": {k: x._asdict() for k, x in found.items()}}) == found
    assert read({}) == {}


def test_environments_that_are_left_go_to_the_variant_with_many_starts():
    algorithm = type("Algorithm", (), {"num_envs": 16})
    tasks = dict.fromkeys(("demo", "jitter", "layout"))
    program = Program("policy-0", [], algorithm, tasks, None)
    assert table_programs._tasks_of_parts(program) == ["demo", "jitter", "jitter", "layout"]
