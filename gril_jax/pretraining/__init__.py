"""Trains an encoder from demonstrations (Eq. 6)."""

from .options import Hyper, Static
from .pretrain import Metrics, TrainParams, TrainState, activity_bits, embed, evaluate, init, step

__all__ = [
    "Hyper", "Metrics", "Static", "TrainParams", "TrainState", "activity_bits", "embed", "evaluate",
    "init", "step",
]  # fmt: skip
