"""RLBench's item in the drawer: pull the drawer open, then put the item in. `SPEC` is its entry."""

from gril_jax.envs.tabletop import spec

__all__ = ["SPEC"]

SPEC = spec("item_in_drawer")
