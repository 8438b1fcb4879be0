"""Converts films to boxes, demonstration sets and batches of arrays."""

from gril_jax.lazy import offer

_HOMES = {
    "BoxesFileDetector": "boxes_csv",
    "Demo": "demo_set",
    "DemoSet": "demo_set",
    "demo_batch": "demo_set",
    "import_magical": "importing",
    "import_videos": "importing",
    "load_demo_set": "demo_set",
    "save_demo_set": "demo_set",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
