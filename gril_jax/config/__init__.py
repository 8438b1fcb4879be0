"""Configurations: their fields, defaults and ranges, as YAML and on the command line.

The networks and algorithms take their own defaults from these sections, so that each is written
once. Names are imported when they are used: a network needs no parser of command lines.
"""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    task="BLOCK_COLOURS BLOCK_SHAPES DemosConfig EnvConfig PLACES TaskName",
    encoder="EncoderOptions PoolConfig",
    reward="LossConfig PretrainConfig",
    run_config="MakeDemosConfig RewardSections RunConfig RunSettings",
    policy="PPOConfig SACConfig",
)
