"""Converts films to boxes, demonstration sets and batches of arrays."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    boxes_csv="BoxesFileDetector",
    demo_set="Demo DemoSet demo_batch load_demo_set save_demo_set",
    importing="import_magical import_videos",
)
