"""Pages, tables and figures about a run."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__, data="read_finished read_profiles", run_report="write_report"
)
