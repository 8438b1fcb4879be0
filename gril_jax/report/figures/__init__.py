"""Figures, one module for each kind."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    filmstrip="contact_sheet",
    curves="learning_curve pretrain_curve reward_profile success_failure",
    style="png",
)
