"""Configurations: their fields, defaults and ranges, as YAML and on the command line."""

from .run_config import (
    BLOCK_COLOURS,
    BLOCK_SHAPES,
    DemosConfig,
    EncoderConfig,
    EnvConfig,
    LossConfig,
    MakeDemosConfig,
    PoolConfig,
    PPOConfig,
    PretrainConfig,
    RunConfig,
    RunSettings,
    SACConfig,
    TaskName,
    Variant,
    check,
)

__all__ = [
    "BLOCK_COLOURS",
    "BLOCK_SHAPES",
    "DemosConfig",
    "EncoderConfig",
    "EnvConfig",
    "LossConfig",
    "MakeDemosConfig",
    "PPOConfig",
    "PoolConfig",
    "PretrainConfig",
    "RunConfig",
    "RunSettings",
    "SACConfig",
    "TaskName",
    "Variant",
    "check",
]
