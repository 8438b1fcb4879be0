"""Figures, one module for each kind."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    filmstrip="beside_reward contact_sheet with_boxes",
    curves="learning_curve pretrain_curve reward_profile success_failure",
    style="png",
)
