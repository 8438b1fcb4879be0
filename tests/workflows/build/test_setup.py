"""The task for an audit: in a variant in which its stages say what a success is."""

import pytest

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
