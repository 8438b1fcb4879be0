"""One run's folder, and the loop that fills it."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    progress="Progress",
    run_dir="RunDir read_config read_metrics read_results",
    reading="read_phases",
    memory="MemoryRun Run",
    loop="run_chunks",
)
