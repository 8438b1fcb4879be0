"""Manipulation tasks in JAX. `make(name)` builds one; `names()` lists them.

The table of tasks is loaded at once and costs nothing; types are loaded when they are first used.
"""

from importlib import import_module
from typing import Any

if __name__ != "gril_jax.envs":  # a second copy would have a second registry
    raise ImportError(f"import this package as gril_jax.envs, not {__name__}")

from .registry import TaskSpec, demonstrate, make, names, options, spec

_ADAPTERS = ("of_brax", "of_gymnax", "of_jumanji")
_TYPES = ("Demonstrations", "Env", "ExpertError", "Objects", "Outline", "State", "Wanted")

__all__ = [*_ADAPTERS, *_TYPES, "TaskSpec", "demonstrate", "make", "names", "options", "spec"]


def __getattr__(name: str) -> Any:
    """A type of the tasks' contract, or what makes a task of another library's, imported now."""
    if name in _TYPES:
        return getattr(import_module("gril_jax.envs.base"), name)
    if name in _ADAPTERS:
        return getattr(import_module("gril_jax.envs.user_tasks.adapters"), name)
    raise AttributeError(f"module 'gril_jax.envs' has no attribute {name!r}")
