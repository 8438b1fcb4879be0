"""RLBench's empty container: bring three things from the tray into a bin. `SPEC` is its entry."""

from gril_jax.envs.tabletop import spec

__all__ = ["SPEC"]

SPEC = spec("empty_container")
