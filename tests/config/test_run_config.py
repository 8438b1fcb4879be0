"""The schema: ranges, contradictions, help texts."""

import ast
import dataclasses
import inspect
import subprocess
import sys
import textwrap

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gril_jax.config import (
    BLOCK_COLOURS,
    BLOCK_SHAPES,
    DemosConfig,
    EncoderOptions,
    EnvConfig,
    MakeDemosConfig,
    PPOConfig,
    PretrainConfig,
    RunConfig,
    RunSettings,
)
from gril_jax.config.command_line import options
from gril_jax.errors import ConfigError

SECTIONS = {f.name: f.default for f in dataclasses.fields(RunConfig)}


def _with(path, value):
    """The default configuration with one field changed."""
    section, name = path.split(".")
    return RunConfig(**{section: dataclasses.replace(SECTIONS[section], **{name: value})})


def _numbers():
    for section, default in SECTIONS.items():
        for field in dataclasses.fields(default):
            value = getattr(default, field.name)
            if isinstance(value, int | float) and not isinstance(value, bool):
                yield f"{section}.{field.name}", field


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([*_numbers()]), st.floats(), st.integers(-(2**40), 2**40))
def test_a_number_is_taken_as_its_rule_says_and_else_named_with_what_would_be_right(
    which, real, whole
):
    path, field = which
    value = real if isinstance(getattr(SECTIONS[path.split(".")[0]], field.name), float) else whole
    if field.metadata["holds"](value):
        section, name = path.split(".")
        found = dataclasses.replace(SECTIONS[section], **{name: value})
        assert getattr(found, name) == value
        return
    with pytest.raises(ConfigError) as caught:
        _with(path, value)
    shown = path.rstrip("_")  # lambda, as on the command line
    assert str(caught.value) == f"{shown} is {value!r}, but must be {field.metadata['text']}"


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("env.episode_length", 0),
        ("env.targets", ("green",)),
        ("env.targets", ("purple star",)),
        ("env.distractors", ("star green",)),
        ("env.options", ("speed",)),
        ("env.options", ("speed=1", "speed=2")),
        ("ppo.hidden", (64, 0)),
        ("run.sinks", ("wandb", "wandb")),
        ("run.out", " "),
    ],
)
def test_a_field_out_of_range_is_named_with_its_value_and_what_would_be_right(path, value):
    with pytest.raises(ConfigError) as caught:
        _with(path, value)
    shown = list(value) if isinstance(value, tuple) else value
    assert str(caught.value).startswith(f"{path} is {shown!r}, but must be ")


@pytest.mark.parametrize(
    ("path", "low", "high"),
    [
        ("env.varied_starts", 0.0, 1.0),
        ("encoder.rounds", 0, 16),
        ("run.seed", 0, 2**31 - 1),
        ("ppo.discounting", 0.0, 1.0),
    ],
)
def test_the_ends_of_a_range_are_inside_it(path, low, high):
    section, name = path.split(".")
    for value in (low, high):
        assert getattr(getattr(_with(path, value), section), name) == value
    for value in (low - 1, high + 1):
        with pytest.raises(ConfigError, match=f"{path} is {value}, but must be from"):
            _with(path, value)


@pytest.mark.parametrize(
    ("path", "value", "fault"),
    [
        ("env.name", "shoes", r"^env: there is no task 'shoes'"),
        ("env.reward", "staged", r"^env: reward is 'staged', but"),
        ("env.targets", (), r"env\.targets is empty"),
        ("env.targets", ("green star",) * 2, "'green star' is named more than once"),
        ("env.distractors", ("green star",), "'green star' is named more than once"),
        ("ppo.num_minibatches", 5, r"ppo\.num_minibatches is 5.* which is 64"),
        ("ppo.num_timesteps", 1279, r"ppo\.num_timesteps is 1279.* = 1280 steps"),
        ("demos.num", 7, r"pretrain\.num_videos is 8.*which is 7"),
    ],
)
def test_what_does_not_fit_together_is_named(path, value, fault):
    with pytest.raises(ConfigError, match=fault):
        _with(path, value)


def test_a_block_without_a_place_in_the_original_scene_needs_the_layout_variant():
    env = EnvConfig(targets=("red star",), variant="jitter")
    with pytest.raises(ConfigError, match=r"env\.variant is 'jitter', but must be 'layout'"):
        RunConfig(env=env)
    everywhere = dataclasses.replace(env, variant="layout")
    assert RunConfig(env=everywhere).env == everywhere
    with pytest.raises(ConfigError, match="--variant is 'demo', but must be 'layout'"):
        everywhere.require_places("--variant", "demo")


@pytest.mark.parametrize(
    ("path", "value", "right"),
    [
        (
            "loss.consistency",
            "both",
            "'tcc', 'tcc_variance', 'tcc_huber', 'tcc_classification', "
            "'tcc_stochastic' or 'tcc_cosine'",
        ),
        ("run.reward", "stages", "'learned' or 'environmental'"),
    ],
)
def test_pixels_refuse_what_needs_boxes(path, value, right):
    section, name = path.split(".")
    parts = dict(SECTIONS, encoder=EncoderOptions(kind="pixels"))
    parts["run"] = dataclasses.replace(parts["run"], algorithm="sac")
    assert RunConfig(**parts).encoder.pixels == 64
    parts[section] = dataclasses.replace(parts[section], **{name: value})
    with pytest.raises(ConfigError) as caught:
        RunConfig(**parts)
    sentence = f"{path} is {value!r}, but must be {right}, because encoder.kind is 'pixels'"
    assert str(caught.value) == sentence


def test_a_reward_is_one_of_the_forms_or_has_been_learned_before():
    for reward in ("kitchen.npz", "runs/one"):
        run = _with("run.reward", reward).run
        assert (run.reward_form, run.reward_source) == ("learned", reward)
    run = _with("run.reward", "stages").run
    assert (run.reward_form, run.reward_source) == ("stages", None)
    with pytest.raises(ConfigError, match=r"run\.reward is 'lerned', but must be 'learned', "):
        _with("run.reward", "lerned")


def test_sub_policies_act_in_stages_and_other_rewards_have_one():
    ppo = PPOConfig(sub_policies=2)
    staged = RunSettings(reward="stages")
    assert RunConfig(ppo=ppo, run=staged).sub_policies == 2
    for run in (RunSettings(), dataclasses.replace(staged, algorithm="sac")):
        assert RunConfig(ppo=ppo, run=run).sub_policies == 1


def test_pixels_learn_a_reward_of_a_task_without_pictures_for_a_policy():
    config = RunConfig(env=EnvConfig(name="shoes_in_box"), encoder=EncoderOptions(kind="pixels"))
    assert config.encoder.precision == "float32"


def test_what_pixels_do_not_use_they_leave_alone():
    box = PretrainConfig(num_perturbations=4, adversarial_steps=2)
    config = RunConfig(encoder=EncoderOptions(kind="pixels", relations=True), pretrain=box)
    assert config.pretrain.num_perturbations == 4  # so that a sweep over encoder.kind has one base


@pytest.mark.parametrize("kind", ["interaction", "mlp", "pixels"])
def test_an_ensemble_is_of_the_papers_encoders(kind):
    assert RunConfig(encoder=EncoderOptions(ensemble_size=4)).encoder.ensemble_size == 4
    with pytest.raises(ConfigError) as caught:
        RunConfig(encoder=EncoderOptions(kind=kind, ensemble_size=4))
    sentence = f"encoder.ensemble_size is 4, but must be 1, because encoder.kind is {kind!r}"
    assert str(caught.value) == sentence


def test_warp_has_room_for_the_environments():
    warp = EnvConfig(name="shoes_in_box", engine="warp", max_envs=32)
    few, enough = RunSettings(eval_episodes=32), PPOConfig(num_envs=32)
    assert RunConfig(env=warp, ppo=enough, run=few).env.max_envs == 32
    for path, changes in {
        "ppo.num_envs": {"ppo": PPOConfig(num_envs=64), "run": few},
        "run.eval_episodes": {"ppo": enough, "run": RunSettings(eval_episodes=64)},
    }.items():
        with pytest.raises(ConfigError) as caught:
            RunConfig(env=warp, **changes)
        assert str(caught.value) == f"env.max_envs is 32, but must be at least {path}, which is 64"
    assert RunConfig(env=EnvConfig(max_envs=32), ppo=PPOConfig(num_envs=64)).env.engine == "auto"


def test_what_just_fits_is_taken():
    assert RunConfig(ppo=PPOConfig(num_timesteps=1280)).ppo.num_timesteps == 1280
    assert RunConfig(demos=DemosConfig(num=7, path="elsewhere")).demos.path == "elsewhere"


def test_the_part_for_demonstrations_is_checked_too():
    with pytest.raises(ConfigError, match=r"^demos\.num is 0"):
        MakeDemosConfig(demos=DemosConfig(num=0))


def test_configurations_are_immutable_and_hashable():
    config = RunConfig()
    with pytest.raises(dataclasses.FrozenInstanceError):
        config.run = None
    assert hash(config) == hash(RunConfig())


def test_every_number_has_a_range():
    for section in SECTIONS.values():
        for field in dataclasses.fields(section):
            value = getattr(section, field.name)
            if isinstance(value, int | float | tuple) and not isinstance(value, bool):
                assert field.metadata, f"{type(section).__name__}.{field.name} has no range"


def test_every_field_has_a_help_text_under_it():
    for section in map(type, SECTIONS.values()):
        told = set()  # a field that a class declares again has the text of its base
        for kind in filter(dataclasses.is_dataclass, reversed(section.mro())):
            (body,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
            pairs = zip(body.body, [*body.body[1:], None], strict=True)
            told |= {
                field.target.id
                for field, text in pairs
                if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr)
            }
        assert {field.name for field in dataclasses.fields(section)} <= told, section.__name__


def test_every_field_is_an_option_and_there_are_few():
    names = {
        f"--{s}.{f.name}".rstrip("_").replace("_", "-")
        for s, section in SECTIONS.items()
        for f in dataclasses.fields(section)
    }
    short = {"--task", "--demos", "--out", "--seed", "--reward", "--algorithm", "--max-steps"}
    assert set(options(RunConfig)) == names | short | {"--lambda"}
    few = (SECTIONS["env"], SECTIONS["demos"], SECTIONS["run"])
    assert sum(len(dataclasses.fields(section)) for section in few) <= 28


def test_the_blocks_and_the_defaults_are_those_of_the_task():
    from gril_jax.envs.magical.match_regions import start, task

    blocks = {f"{c} {s}" for c in BLOCK_COLOURS for s in BLOCK_SHAPES}
    assert blocks == set(task.CLASSES) - {"goal", "robot"}
    assert EnvConfig().targets == task.TARGETS
    assert EnvConfig().distractors == task.DISTRACTORS
    placed = {*EnvConfig().targets, *EnvConfig().distractors}
    assert placed == set(start.DEMO_BLOCKS)


def test_the_schema_imports_nothing_heavy():
    code = (
        "import sys, gril_jax.config, gril_jax.config.files, gril_jax.runs.run_dir, gril_jax.cli\n"
        "print([m for m in ('jax', 'numpy', 'mujoco', 'orbax', 'rich') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize(
    ("loss", "section", "other", "needed"),
    [
        (
            "timerewarder",
            "pretrain",
            {"num_perturbations": 2},
            "num_perturbations is 2, but must be 0",
        ),
        ("progressor", "loss", {"goals": 3}, "loss.goals is 3, but must be 1"),
        ("rewind", "encoder", {"ensemble_size": 2}, "ensemble_size is 2, but must be 1"),
        ("soft_dtw", "pretrain", {"rewind": 0.5}, "pretrain.rewind is 0.5, but must be 0"),
    ],
)
def test_a_consistency_that_cannot_have_another_option_refuses_it(loss, section, other, needed):
    changes = {"loss": {"consistency": loss}}
    changes.setdefault(section, {}).update(other)
    chosen = {name: dataclasses.replace(SECTIONS[name], **x) for name, x in changes.items()}
    with pytest.raises(ConfigError, match=f"{needed}, because loss.consistency is '{loss}'"):
        RunConfig(**chosen)
