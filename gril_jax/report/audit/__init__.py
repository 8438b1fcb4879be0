"""The page of an audit: its findings in numbers and words, and pictures of states."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__, maps="reward_maps state_pictures", page="Findings write_report"
)
