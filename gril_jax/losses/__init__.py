"""The losses an encoder is trained with, each in its own file."""

from .reconstruction import decode, reconstruction
from .tcc import cycle_consistency, mean_consistency, time_agreement

__all__ = [
    "cycle_consistency",
    "decode",
    "mean_consistency",
    "reconstruction",
    "time_agreement",
]
