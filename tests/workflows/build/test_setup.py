"""The task for an audit: in a variant in which its stages say what a success is."""

import pytest
from support import own_task

from gril_jax.api import inputs
from gril_jax.config import EnvConfig
from gril_jax.errors import ConfigError
from gril_jax.workflows.build import setup


def test_an_audit_is_of_a_variant_whose_blocks_the_stages_know():
    own = EnvConfig(name="cluster_colour", variant="color")
    assert setup.staged_env(own, None).variant == "demo"
    assert setup.staged_env(own, "layout").variant == "layout"
    with pytest.raises(ConfigError, match="the stages of cluster_colour know the colours, shapes"):
        setup.staged_env(own, "all")
    assert setup.staged_env(EnvConfig(name="move_to_region"), "all").variant == "all"
    assert setup.staged_env(EnvConfig(variant="all"), None).variant == "all"


def test_a_task_of_one_s_own_has_its_own_variants(tmp_path, monkeypatch):
    own_task.home(tmp_path, monkeypatch)
    monkeypatch.chdir(tmp_path)
    made = "speed=1.0):", 'speed=1.0, variant="easy"):\n    Task.asked = speed, variant'
    own_task.write(tmp_path, name="varied.py", made=made)
    own_task.write(tmp_path)

    def asked(config, variant=None):
        return setup.make_env(config, training=False, variant=variant).task.asked

    for_policies = inputs.env_config("varied.py:make", EnvConfig(variant="hard"))
    assert asked(for_policies) == (1.0, "hard")
    assert asked(for_policies, "far") == (1.0, "far")
    made_before = inputs.env_config(inputs.make("varied.py", speed=2.0), EnvConfig())
    assert asked(made_before) == asked(made_before, "demo") == (2.0, "easy")
    assert made_before.name == f"{tmp_path / 'varied.py'}:make"
    hard = inputs.env_config(inputs.make("varied.py", variant="hard"), EnvConfig())
    assert (hard.variant, asked(hard), asked(hard, "far")) == ("hard", (1.0, "hard"), (1.0, "far"))
    named = inputs.env_config(inputs.make("varied.py", variant="demo"), EnvConfig())
    assert asked(named) == (1.0, "demo")
    plain = inputs.env_config("my_task.py:make", EnvConfig(variant="jitter"))
    with pytest.raises(ConfigError, match="is 'jitter', but my_task takes no option variant"):
        asked(plain)
    with pytest.raises(ConfigError, match=r"env\.variant is 'hard', but must be one of demo,"):
        EnvConfig(variant="hard").check()


def test_options_of_a_task_of_one_s_own_may_have_the_names_of_fields(tmp_path, monkeypatch):
    own_task.home(tmp_path, monkeypatch)
    monkeypatch.chdir(tmp_path)
    made = (
        "speed=1.0):",
        "engine=1, varied_starts=0.25, **more):\n    Task.asked = engine, varied_starts, more",
    )
    own_task.write(tmp_path, change=made)
    config = inputs.env_config(inputs.make("my_task.py", engine=7, far=True), EnvConfig())
    trained, played = (
        setup.make_env(config, training=training, variant=variant).task.asked
        for training, variant in ((True, None), (False, "wide"))
    )
    assert trained == (7, 0.25, {"far": True})
    assert played == (7, 0.0, {"far": True, "variant": "wide"})
