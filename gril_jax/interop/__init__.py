"""Exported files, and adapters to other libraries: one module each."""

from gril_jax.lazy import offer

_HOMES = {
    "RewardFileError": "reward_file",
    "load_reward": "reward_file",
    "policy_arrays": "policy_file",
    "save_reward": "reward_file",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
