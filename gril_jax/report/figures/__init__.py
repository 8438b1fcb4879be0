"""Figures, one module for each kind."""

from gril_jax.lazy import offer

_HOMES = {
    "beside_reward": "filmstrip",
    "contact_sheet": "filmstrip",
    "learning_curve": "curves",
    "png": "style",
    "pretrain_curve": "curves",
    "reward_profile": "curves",
    "success_failure": "curves",
    "with_boxes": "filmstrip",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
