"""Compiling ahead of time, on one device or on several."""

from gril_jax.lazy import offer

_HOMES = {
    "advance": "sharding",
    "compiled": "compiler",
    "compiling": "ahead",
    "mesh": "sharding",
    "predict_bytes": "memory",
    "tracing": "ahead",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
