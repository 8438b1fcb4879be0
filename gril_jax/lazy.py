"""Public names of a package that are loaded when they are first used (PEP 562).

    __all__ = ["load_reward"]
    __getattr__ = offer(__name__, {"load_reward": "reward_file"})

A package that lists heavy modules in this way costs nothing to import. Nothing but the standard
library is imported here.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def offer(package: str, homes: Mapping[str, str]) -> Callable[[str], Any]:
    """A package's `__getattr__`.

    Args:
      package: its `__name__`.
      homes: a public name to the module that defines it, relative to the package; a name that
        maps to itself, or that its home lacks, stands for the module.

    Raises:
      AttributeError: from what is returned, for a name that is not offered.
    """

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = import_module(f"{package}.{homes[name]}")
        return getattr(module, name, module)

    return load
