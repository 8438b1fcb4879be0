"""Configurations: their fields, defaults and ranges, as YAML and on the command line.

The networks and algorithms take their own defaults from these sections, so that each is written
once. Names are imported when they are used: a network needs no parser of command lines.
"""

from importlib import import_module
from typing import Any

_HOMES = {
    "BLOCK_COLOURS": "task",
    "BLOCK_SHAPES": "task",
    "DemosConfig": "task",
    "EncoderOptions": "encoder",
    "EnvConfig": "task",
    "LossConfig": "reward",
    "MakeDemosConfig": "run_config",
    "PPOConfig": "policy",
    "PoolConfig": "encoder",
    "PretrainConfig": "reward",
    "RunConfig": "run_config",
    "RunSettings": "run_config",
    "SACConfig": "policy",
    "TaskName": "task",
    "Variant": "task",
    "check": "run_config",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    """A public name, imported now."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
