"""Frames: video files, colours and shapes found in them, and pictures drawn from boxes."""

from gril_jax.lazy import offer

__all__, __getattr__ = offer(
    __name__,
    detect="ColourDetector Detector",
    render="paint",
    video="read_fps read_video write_video",
)
