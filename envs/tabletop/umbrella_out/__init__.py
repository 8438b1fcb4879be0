"""RLBench's umbrella out of its stand: grasp it and lift it out. `SPEC` is its entry."""

from gril_jax.envs.tabletop import spec

__all__ = ["SPEC"]

SPEC = spec("umbrella_out")
