"""Compiling ahead of time, on one device or on several."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    sharding="advance mesh",
    compiler="compiled",
    ahead="compiling tracing",
    memory="predict_bytes",
)
