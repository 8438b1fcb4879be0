"""RLBench's shoes in the box: open its lid, then put both shoes in. `SPEC` is its entry."""

from gril_jax.envs.tabletop import spec

__all__ = ["SPEC"]

SPEC = spec("shoes_in_box", config="")
