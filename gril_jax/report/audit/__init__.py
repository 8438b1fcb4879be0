"""The page of an audit: its findings in numbers and words, and pictures of states."""

from gril_jax.lazy import offer

_HOMES = {
    "Findings": "findings",
    "reward_maps": "maps",
    "state_pictures": "maps",
    "write_report": "page",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
