"""From demonstrations to an encoder (Eq. 6)."""

from .options import Hyper, PretrainConfig
from .pretrain import Metrics, State, TrainParams, activity_bits, embed, evaluate, init, step

__all__ = [
    "Hyper",
    "Metrics",
    "PretrainConfig",
    "State",
    "TrainParams",
    "activity_bits",
    "embed",
    "evaluate",
    "init",
    "step",
]
