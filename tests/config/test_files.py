"""YAML and command line into one configuration, and back."""

import dataclasses
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gril_jax.config import (
    DemosConfig,
    EnvConfig,
    LossConfig,
    MakeDemosConfig,
    PPOConfig,
    RunConfig,
    RunSettings,
)
from gril_jax.config.files import find, load, names, to_yaml
from gril_jax.errors import ConfigError


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "mine.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return str(path)

    return write


def _fault(*args, **kwargs):
    with pytest.raises(ConfigError) as caught:
        load(*args, **kwargs)
    text = str(caught.value)
    assert "\n" not in text
    return text


# --- files


@pytest.mark.parametrize("name", names())
def test_every_shipped_configuration_loads_and_says_how_to_run_it(name):
    assert isinstance(load(name), RunConfig)
    first = find(name).read_text().splitlines()[0]
    assert first.startswith("# gril ")
    assert name in first.split()


def test_no_file_gives_the_defaults():
    assert load() == RunConfig()


def test_an_empty_file_gives_the_defaults(write):
    assert load(write("# nothing\n")) == RunConfig()


def test_a_file_changes_what_it_names_and_nothing_else(write):
    config = load(write("pool:\n  alpha: 2\nloss:\n  lambda: 3e-4\n"))
    assert config.pool.alpha == 2.0
    assert config.loss.lambda_ == 3e-4  # YAML alone would read a string
    assert config == dataclasses.replace(RunConfig(), pool=config.pool, loss=config.loss)


def test_the_command_line_overrides_the_file(write):
    path = write("ppo:\n  num_envs: 32\n  unroll_length: 5\n")
    config = load(path, ["--ppo.num-envs", "16"])
    assert (config.ppo.num_envs, config.ppo.unroll_length) == (16, 5)


def test_the_last_of_two_equal_options_counts():
    assert load(None, ["--run.seed", "1", "--run.seed=2"]).run.seed == 2


def test_underscores_and_hyphens_are_one_on_the_command_line():
    assert load(None, ["--ppo.num_envs=8"]) == load(None, ["--ppo.num-envs=8"])


def test_an_empty_list_is_an_empty_tuple(write):
    assert load(write("env:\n  distractors: []\n")).env.distractors == ()


def test_a_part_of_the_schema_takes_its_part_of_the_file():
    part = load("quickstart", ["--demos.num", "9"], schema=MakeDemosConfig)
    whole = load("quickstart")
    assert part == MakeDemosConfig(whole.env, dataclasses.replace(whole.demos, num=9))


def test_a_part_of_the_schema_still_refuses_a_file_with_a_fault_elsewhere(write):
    text = _fault(write("ppo:\n  num_envs: 0\n"), schema=MakeDemosConfig)
    assert "ppo.num_envs is 0" in text


@pytest.mark.parametrize(
    ("yaml", "fault"),
    [
        ("env:\n  targts: 3\n", "there is no field env.targts (did you mean targets?)"),
        ("env:\n  zzz: 3\n", "there is no field env.zzz beside name, robot"),
        ("evn: {}\n", "there is no section 'evn' (did you mean env?)"),
        ("true: {}\n", "there is no section True beside env"),
        ("env:\n  robot: tall\n", "--env.robot is 'tall', but must be one of gripper, short"),
        ("env:\n  substeps: many\n", "--env.substeps is 'many', but must be a whole number"),
        ("pool:\n  noise: much\n", "--pool.noise is 'much', but must be a number"),
        ("env:\n  substeps: 1.5\n", "--env.substeps is '1.5', but must be a whole number"),
        ("env:\n  substeps: [1]\n", "env.substeps must be a single value"),
        ("env:\n  targets: green star\n", "env.targets is 'green star', but must be a list"),
        ("env:\n  targets: [[a]]\n", "env.targets must be a list of single values"),
        ("env:\n  robot: {a: 1}\n", "env.robot must be a single value"),
        ("env: 3\n", "section 'env' must hold fields"),
        ("- env\n", "the file must hold sections"),
        ("3\n", "the file must hold sections"),
        ("pool:\n  tau: 1\n  tau: 2\n", "'tau' is given twice, in line 2 and in line 3"),
        ("pool: {}\nenv: {}\npool: {}\n", "'pool' is given twice, in line 1 and in line 3"),
        ("env: [\n", "the file is not YAML"),
        ("a: 1\n---\nb: 2\n", "the file is not YAML"),
        ("? [1]\n: 2\n", "the file is not YAML"),
        (b"\xff\xfe\x00", "the file is not YAML"),
        (b"env: \x00", "the file is not YAML"),
        ("env: !!python/object/apply:os.getcwd []\n", "could not determine a constructor"),
        ("loss:\n  lambda: -1\n", "loss.lambda is -1.0, but must be"),
    ],
)
def test_a_faulty_file_is_named_with_its_fault(write, yaml, fault):
    path = write(yaml)
    text = _fault(path)
    assert text.startswith(f"{path}: ")
    assert fault in text


def test_a_shipped_name_that_is_misspelt_is_suggested():
    assert "'quikstart' (did you mean quickstart?)" in _fault("quikstart")


def test_a_path_that_is_no_file_is_told(tmp_path):
    assert _fault("a/b.yaml") == (
        "configuration file a/b.yaml does not exist, but must be a YAML file"
    )
    assert "is a folder" in _fault(str(tmp_path))


# --- the command line


@pytest.mark.parametrize(
    ("args", "fault"),
    [
        (["--ppo.num-evs", "3"], "no option --ppo.num-evs (did you mean --ppo.num-envs?)"),
        (["--num-envs=3"], "no option --num-envs (did you mean --ppo.num-envs?)"),
        (["--zzz"], "there is no option --zzz: see gril train --help"),
        (["-x"], "there is no option -x"),
        (["--ppo.num-envs"], "--ppo.num-envs is given without a value"),
        (["--ppo.num-envs", "abc"], "--ppo.num-envs is 'abc', but must be a whole number"),
        (["--pool.alpha", "a b"], "--pool.alpha is 'a b', but must be a number"),
        (["--ppo.hidden", "3", "x"], "--ppo.hidden is '3 x', but must be whole numbers"),
        (["--encoder.robot", "y"], "is 'y', but must be one of True, False"),
        (["--env.turn", "left"], "--env.turn is 'left', but must be one of original, smooth"),
        (["stray"], "there is no use for 'stray': see gril train --help"),
        (["--loss.lambda=nan"], "loss.lambda is nan, but must be finite and at least 0"),
        (["--ppo.num-envs=0"], "ppo.num_envs is 0, but must be finite and at least 1"),
    ],
)
def test_a_faulty_option_is_one_sentence(args, fault):
    assert fault in _fault(None, args)


def test_a_fault_of_the_command_line_is_not_blamed_on_the_file():
    assert _fault("quickstart", ["--ppo.num-envs=0"]).startswith("ppo.num_envs is 0")


# --- the round trip


@pytest.mark.parametrize("name", [None, *names()])
def test_a_resolved_configuration_loads_to_an_equal_one(write, name):
    config = load(name)
    assert load(write(to_yaml(config))) == config


_words = st.text(st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=1)


@settings(max_examples=25, deadline=None)
@given(
    rate=st.floats(1e-300, 1e300),
    weight=st.floats(0, 1e9),
    share=st.floats(0, 1),
    hidden=st.lists(st.integers(1, 10**6), max_size=4),
    seed=st.integers(0, 2**31 - 1),
    out=st.none() | _words.filter(lambda s: s.strip() and s != "None"),
    flag=st.booleans(),
)
def test_any_configuration_survives_the_round_trip(
    tmp_path_factory, rate, weight, share, hidden, seed, out, flag
):
    config = RunConfig(
        env=EnvConfig(varied_starts=share, distractors=()),
        demos=DemosConfig(path=out),
        loss=LossConfig(lambda_=weight),
        ppo=PPOConfig(learning_rate=rate, hidden=tuple(hidden), observe_activity=flag),
        run=RunSettings(seed=seed, out=out),
    )
    path = tmp_path_factory.mktemp("round") / "config.yaml"
    path.write_text(to_yaml(config), encoding="utf-8")
    again = load(str(path))
    assert again == config
    assert math.isclose(again.ppo.learning_rate, rate, rel_tol=0)
