"""RLBench's shoes out of the box: open its lid, then take both shoes out. `SPEC` is its entry."""

from gril_jax.envs.tabletop import spec

__all__ = ["SPEC"]

SPEC = spec("shoes_out_of_box")
