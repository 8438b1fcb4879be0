"""Exported files, and adapters to other libraries: one module each."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__, reward_file="RewardFileError load_reward save_reward", policy_file="policy_arrays"
)
