"""Configurations: their fields, defaults and ranges, as YAML and on the command line.

The networks and algorithms take their own defaults from these sections, so that each is written
once. Names are imported when they are used: a network needs no parser of command lines.
"""

from gril_jax.lazy import offer

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
__getattr__ = offer(__name__, _HOMES)
