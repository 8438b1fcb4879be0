"""YAML and command line into one configuration, and back."""

import dataclasses

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.configurations import FIELDS, changed, changes

from gril_jax.config import RunConfig
from gril_jax.config.files import find, load, names, to_yaml
from gril_jax.errors import ConfigError


@pytest.fixture
def write(tmp_path):
    def write(text, name="mine"):
        path = tmp_path / f"{name}.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return str(path)

    return write


def _fault(*args):
    with pytest.raises(ConfigError) as caught:
        load(*args)
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


def test_a_file_changes_what_it_names_and_nothing_else(write):
    assert load() == load(write("# nothing\n")) == RunConfig()
    config = load(write("pool:\n  alpha: 2\nloss:\n  lambda: 3e-4\nenv:\n  distractors: []\n"))
    assert config.pool.alpha == 2.0
    assert config.loss.lambda_ == 3e-4  # YAML alone would read a string
    env = dataclasses.replace(RunConfig().env, distractors=())
    assert config == dataclasses.replace(RunConfig(), pool=config.pool, loss=config.loss, env=env)


@pytest.mark.parametrize(
    "words",
    [
        ["--encoder.robot", "true", "--ppo.observe-activity=false"],
        ["--encoder.robot=True", "--ppo.observe_activity", "false"],
    ],
)
def test_a_switch_is_written_as_in_yaml_or_in_python(words):
    config = load("quickstart", [*words, "--run.out", "true"], prog="")
    assert (config.encoder.robot, config.ppo.observe_activity) == (True, False)
    assert config.run.out == "true"  # a folder of that name


def test_the_command_line_counts_above_the_file_and_its_last_word_most(write):
    path = write("ppo:\n  num_envs: 32\n  unroll_length: 5\n")
    for args in (["--ppo.num-envs", "8", "--ppo.num_envs=16"], ["--ppo.num-envs=16"]):
        config = load(path, args)
        assert (config.ppo.num_envs, config.ppo.unroll_length) == (16, 5)
    assert load(None, ["--seed", "3", "--lambda=2", "--demos", "x"]) == load(
        None, ["--run.seed", "3", "--loss.lambda=2", "--demos.path", "x"]
    )


@pytest.mark.parametrize(
    ("yaml", "fault"),
    [
        ("env:\n  targts: 3\n", "there is no field env.targts (did you mean targets?)"),
        ("env:\n  zzz: 3\n", "there is no field env.zzz beside name, targets"),
        ("evn: {}\n", "there is no section 'evn' (did you mean env?)"),
        ("true: {}\n", "there is no section True beside env"),
        ("env:\n  engine: tall\n", "--env.engine is 'tall', but must be one of auto, kernel"),
        ("env:\n  max_envs: many\n", "--env.max-envs must be a whole number: invalid literal"),
        ("pool:\n  noise: much\n", "--pool.noise must be None or a number: could not convert"),
        ("env:\n  episode_length: [1]\n", "env.episode_length must be a single value"),
        ("env:\n  targets: green star\n", "env.targets is 'green star', but must be a list"),
        ("env:\n  targets: [[a]]\n", "env.targets must be a list of single values"),
        ("env:\n  engine: {a: 1}\n", "env.engine must be a single value"),
        ("env: 3\n", "section 'env' must hold fields"),
        ("- env\n", "the file must hold sections"),
        ("pool:\n  tau: 1\n  tau: 2\n", "'tau' is given twice, in line 2 and in line 3"),
        ("pool: {}\nenv: {}\npool: {}\n", "'pool' is given twice, in line 1 and in line 3"),
        ("env: [\n", "the file is not YAML"),
        ("a: 1\n---\nb: 2\n", "the file is not YAML"),
        ("? [1]\n: 2\n", "the file is not YAML"),
        (b"\xff\xfe\x00", "the file is not YAML"),
        ("env: !!python/object/apply:os.getcwd []\n", "could not determine a constructor"),
        ("loss:\n  lambda: -1\n", "loss.lambda is -1.0, but must be"),
    ],
)
def test_a_faulty_file_is_named_with_its_fault(write, yaml, fault):
    path = write(yaml)
    text = _fault(path, ["--run.seed", "1"])
    assert text.startswith(f"{path}: ")
    assert fault in text


def test_a_configuration_that_is_not_there_is_told(tmp_path):
    assert "'quikstart' (did you mean quickstart?)" in _fault("quikstart")
    assert _fault("a/b.yaml") == (
        "configuration file a/b.yaml does not exist, but must be a YAML file"
    )
    assert "is a folder" in _fault(str(tmp_path))


# --- bases


def test_a_file_counts_above_its_base_and_that_above_the_defaults(write):
    write("base: quickstart\nppo:\n  num_envs: 512\nenv:\n  targets: [red star]\n", "policy")
    config, under = (
        load(write("base: policy.yaml\nppo:\n  num_minibatches: 8\n")),
        load("quickstart"),
    )
    ppo = dataclasses.replace(under.ppo, num_envs=512, num_minibatches=8)
    env = dataclasses.replace(under.env, targets=("red star",))
    assert config == dataclasses.replace(under, ppo=ppo, env=env)


@pytest.mark.parametrize(
    ("base", "fault"),
    [
        ("quikstart", "there is no configuration 'quikstart' (did you mean quickstart?)"),
        ("gone.yaml", "gone.yaml does not exist, but must be a YAML file"),
        ("mine.yaml", "its base leads back to itself, by way of"),
        ("[quickstart]", "base must be the name of one configuration, or the path of its file"),
        ("3", "base must be the name"),
    ],
)
def test_a_base_that_cannot_be_had_is_refused(write, base, fault):
    path = write(f"base: {base}\n")
    assert _fault(path).startswith(f"{path}: ")
    assert fault in _fault(path)


def test_a_fault_is_blamed_on_the_file_that_it_is_in(write):
    for yaml in ("base: mine.yaml\n", "ppo: {num_envs: x}\n", "ppo: {num_evs: 3}\n"):
        base = write(yaml, "base")
        path = write("base: base.yaml\nrun:\n  seed: 1\n")
        assert _fault(path).startswith(f"{path if 'base:' in yaml else base}: ")


# --- the command line


@pytest.mark.parametrize(
    ("args", "fault"),
    [
        (["--ppo.num-evs", "3"], "no option --ppo.num-evs (did you mean --ppo.num-envs?)"),
        (["--num-envs=3"], "no option --num-envs (did you mean --ppo.num-envs?)"),
        (["-x"], "there is no option -x: see gril train --help"),
        (["--ppo.num-envs"], "--ppo.num-envs is given without a value, but must be a whole number"),
        (["--ppo.num-envs", "abc"], "--ppo.num-envs must be a whole number: invalid literal"),
        (["--pool.alpha", "a b"], "--pool.alpha must be a number: could not convert"),
        (["--ppo.hidden", "3", "x"], "--ppo.hidden must be whole numbers separated by spaces"),
        (["--encoder.robot", "y"], "is 'y', but must be one of True, False"),
        (["--algorithm", "x"], "--run.algorithm is 'x', but must be one of ppo, sac"),
        (["stray"], "there is no use for 'stray': see gril train --help"),
        (["--loss.lambda=nan"], "loss.lambda is nan, but must be finite and at least 0"),
        (["--ppo.num-envs=0"], "ppo.num_envs is 0, but must be finite and at least 1"),
    ],
)
def test_a_faulty_option_is_one_sentence_that_does_not_blame_the_file(args, fault):
    said = _fault("quickstart", args)
    assert fault in said
    assert "yaml" not in said


@settings(max_examples=25, deadline=None)
@given(st.sampled_from([*FIELDS.values()]), st.integers(0, 100), st.sampled_from("qxz"))
def test_an_unknown_option_is_refused_with_a_known_one(field, at, letter):
    name, _ = field
    at = name.index(".") + 1 + at % (len(name) - name.index("."))
    wrong = f"{name[:at]}{letter}{name[at:]}"
    said = _fault(None, [f"{wrong}=1"])
    assert said.startswith(f"there is no option {wrong} (did you mean --")


# --- the round trips


def _argv(config):
    for (section, name), (option, _) in FIELDS.items():
        value = getattr(getattr(config, section), name)
        yield from (
            (option, *map(str, value)) if isinstance(value, tuple) else (f"{option}={value}",)
        )


@pytest.mark.parametrize("name", names())
def test_a_shipped_configuration_loads_to_an_equal_one(write, name):
    assert load(write(to_yaml(load(name)))) == load(name)


@settings(max_examples=25, deadline=None)
@given(fields=changes())
def test_any_configuration_survives_yaml_and_the_command_line(tmp_path_factory, fields):
    config = changed(fields)
    path = tmp_path_factory.mktemp("round") / "config.yaml"
    path.write_text(to_yaml(config), encoding="utf-8")
    assert load(str(path)) == config
    assert load(None, [*_argv(config)]) == config
    assert load("quickstart", [*_argv(config)]) == config
