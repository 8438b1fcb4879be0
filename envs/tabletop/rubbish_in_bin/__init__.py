"""RLBench's rubbish in the bin: a piece of rubbish among two tomatoes. `SPEC` is its entry."""

from gril_jax.envs.tabletop import spec

__all__ = ["SPEC"]

SPEC = spec("rubbish_in_bin")
