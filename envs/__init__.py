"""Manipulation tasks in JAX. `make(name)` builds one; `names()` lists them."""

if __name__ != "gril_jax.envs":  # a second copy would have a second registry
    raise ImportError(f"import this package as gril_jax.envs, not {__name__}")

from .base import Env, Objects, State
from .registry import make, names

__all__ = ["Env", "Objects", "State", "make", "names"]
