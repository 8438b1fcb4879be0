"""Checkpoints of a run, written completely or not at all."""

from gril_jax.lazy import offer

_HOMES = {
    "CheckpointWriter": "writer",
    "DamagedError": "checkpoint",
    "latest": "checkpoint",
    "restore": "checkpoint",
    "save": "checkpoint",
    "steps": "checkpoint",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
