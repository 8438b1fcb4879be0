"""Pages, tables and figures about a run."""

from gril_jax.lazy import offer

_HOMES = {
    "read_finished": "data",
    "read_profiles": "data",
    "read_rollouts": "data",
    "write_report": "run_report",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
