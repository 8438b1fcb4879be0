"""Checkpoints of a run, written completely or not at all."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__, writer="CheckpointWriter", checkpoint="DamagedError latest restore save steps"
)
