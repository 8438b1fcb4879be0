"""Frames: video files, colours and shapes found in them, and pictures drawn from boxes."""

from gril_jax.lazy import offer

_HOMES = {
    "ColourDetector": "detect",
    "Detector": "detect",
    "Tracks": "detect",
    "paint": "render",
    "read_fps": "video",
    "read_video": "video",
    "write_video": "video",
}

__all__ = sorted(_HOMES)

__getattr__ = offer(__name__, _HOMES)
