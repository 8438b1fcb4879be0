"""Public names of a package that are loaded when they are first used (PEP 562).

    __all__, __getattr__ = offer(__name__, reward_file="load_reward save_reward")

A package that lists heavy modules in this way costs nothing to import. Nothing but the standard
library is imported here.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def offer(package: str, **homes: str) -> tuple[list[str], Callable[[str], Any]]:
    """The `__all__` and `__getattr__` of the package of this `__name__`.

    Each of its modules comes with the public names that it defines, with a space between them; a
    name that the module lacks stands for the module itself.
    """
    home = {name: module for module, names in homes.items() for name in names.split()}

    def load(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = import_module(f"{package}.{home[name]}")
        return getattr(module, name, module)

    return sorted(home), load
