"""One run's folder, and the loop that fills it."""

from gril_jax.lazy import offer

_HOMES = {
    "Progress": "progress",
    "RunDir": "run_dir",
    "read_config": "run_dir",
    "read_metrics": "run_dir",
    "read_phases": "phases",
    "read_results": "run_dir",
    "run_chunks": "loop",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
