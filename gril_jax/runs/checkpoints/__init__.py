"""Checkpoints of a run, written completely or not at all."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    writer="CheckpointWriter",
    manifest="DamagedError latest steps",
    checkpoint="discard keep_newest newest restore save save_arrays save_part",
)
