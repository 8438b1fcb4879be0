"""Axes of a sweep, made of options with commas, and the cells that they span."""

import pytest

from gril_jax.config.files import load
from gril_jax.config.grid import cells, take_axes, with_seed
from gril_jax.errors import ConfigError


def test_options_with_commas_are_taken_and_the_others_stay_in_their_order():
    args = ["--reward", "learned,environmental", "--ppo.num-envs", "8", "--loss.lambda=0.1, 1"]
    assert take_axes(args) == {
        "--run.reward": ("learned", "environmental"),
        "--loss.lambda": ("0.1", "1"),
    }
    assert args == ["--ppo.num-envs", "8"]


@pytest.mark.parametrize(
    "args",
    [[], ["--help"], ["--env.targets", "red star"], ["--run.out=a"], ["a,b", "--rows", "a,b"]],
)
def test_arguments_without_an_axis_stay_as_they_are(args):
    before = list(args)
    assert take_axes(args) == {}
    assert args == before


@pytest.mark.parametrize(
    ("args", "sentence"),
    [
        (["--loss.lambda", "1,,2"], "--loss.lambda is '1,,2', but must have a value between all"),
        (["--loss.lambda", "1,2,"], "a value between all commas"),
        (["--loss.lambda", "1,2,1"], "must name 1 once"),
        (["--run.seed=1,2"], "--run.seed cannot be an axis: --seeds N takes N seeds from it on"),
        (["--pool.noise", "1,2", "--pool.noise=3,4"], "--pool.noise is given twice"),
    ],
)
def test_what_is_no_axis_is_refused_in_one_sentence(args, sentence):
    with pytest.raises(ConfigError, match=sentence):
        take_axes(args)


def test_cells_are_every_combination_and_the_last_axis_changes_fastest():
    found = cells({"--run.reward": ("learned", "environmental"), "--loss.lambda": ("0.1", "1")})
    assert [*found] == [
        f"reward {r}, lambda {x}" for r in ("learned", "environmental") for x in ("0.1", "1")
    ]
    options = found["reward environmental, lambda 1"]
    assert options == ["--run.reward", "environmental", "--loss.lambda", "1"]
    assert cells({}) == {"as configured": []}


def test_seeds_count_from_that_of_the_configuration():
    config = load(None, ["--run.seed", "7"], prog="gril sweep")
    assert [with_seed(config, k).run.seed for k in range(3)] == [7, 8, 9]
    assert with_seed(config, 0) == config
