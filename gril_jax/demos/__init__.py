"""Converts videos to boxes, demonstration sets and batches of arrays."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    demo="Demo Tracks",
    demo_set="DemoSet demo_batch load_demo_set save_demo_set",
    importing="import_videos",
)
