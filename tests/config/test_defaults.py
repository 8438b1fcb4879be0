"""Each default is written once: a library's option type takes it from the section that has it."""

import ast
import dataclasses
import inspect
import textwrap

import pytest

from gril_jax.config import EncoderOptions, LossConfig, PoolConfig, PPOConfig, PretrainConfig
from gril_jax.config import SACConfig as SACSection
from gril_jax.encoders import EncoderConfig, InteractionConfig, MLPConfig, PixelConfig
from gril_jax.graphs.activity_rule import ActivityRule
from gril_jax.pretraining import options
from gril_jax.rl import ppo, sac
from gril_jax.rl.episodes import Episodes

TRAINED = (LossConfig, PoolConfig, PretrainConfig)
OF = {  # a library's option type, and the sections that it is made from
    options.Static: TRAINED, options.PixelStatic: TRAINED, options.Hyper: TRAINED,
    ppo.Static: (PPOConfig, PoolConfig), ppo.Hyper: (PPOConfig, PoolConfig),
    sac.Static: (SACSection, PoolConfig), sac.Hyper: (SACSection, PoolConfig),
    EncoderConfig: (EncoderOptions,), InteractionConfig: (EncoderOptions,),
    MLPConfig: (EncoderOptions,), PixelConfig: (EncoderOptions,),
    ActivityRule: (PoolConfig,), Episodes: (PoolConfig,),
}  # fmt: skip

# What a type has otherwise than a run: GraphIRL's own sizes, frames of any size, and what only
# scenes from above should have.
OTHERWISE = {
    "InteractionConfig": {"width"},
    "MLPConfig": {"width"},
    "PixelConfig": {"pixels"},
    "PixelStatic": {"turn_scenes"},
    "Static": {"random_activity", "observe_activity"},
    "Episodes": {"observe_activity"},
}


def _written(kind):
    """The defaults that a class writes out: name to value."""
    body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0].body
    entries = (x for x in body if isinstance(x, ast.AnnAssign) and x.value is not None)
    taken = (ast.Attribute, ast.Call)  # Section.field, or float(Section.field)
    return {x.target.id: x.value for x in entries if not isinstance(x.value, taken)}


def _stray(kind, sections):
    named = {field.name for section in sections for field in dataclasses.fields(section)}
    return {*_written(kind)} & named - OTHERWISE.get(kind.__name__, set())


@pytest.mark.parametrize("kind", OF, ids=lambda kind: kind.__module__ + "." + kind.__qualname__)
def test_no_default_of_a_section_is_written_again(kind):
    assert not _stray(kind, OF[kind])


def test_a_second_default_is_found():
    @dataclasses.dataclass
    class Second:
        num_envs: int = 64
        window: int = PoolConfig.window
        alpha: float = 5.0

    assert _stray(Second, (PPOConfig, PoolConfig)) == {"num_envs", "alpha"}


@pytest.mark.parametrize(
    ("module", "names"),
    [
        ("graphs.activity", {"tau", "window", "smoothing"}),
        ("reward.latent_goal", {"alpha"}),
        ("encoders.encoder", {"alpha"}),
        ("encoders.message_passing", {"alpha"}),
        ("pretraining.final_places", {"near_cost_fraction", "intrusion_weight", "touch"}),
    ],
)
def test_nor_in_the_arguments_of_a_function(module, names):
    source = inspect.getsource(__import__(f"gril_jax.{module}", fromlist=["_"]))
    for function in ast.walk(ast.parse(source)):
        if isinstance(function, ast.FunctionDef) and not function.name.startswith("_"):
            given = function.args
            pairs = zip(given.kwonlyargs, given.kw_defaults, strict=True)
            written = {a.arg for a, value in pairs if isinstance(value, ast.Constant)}
            assert not written & names, function.name
