"""Boxes in pixels of a picture -> boxes in world units, as imported demonstrations have them."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Float, Real

from gril_jax.errors import ConfigError, ShapeError


def boxes_from_pixels(
    boxes: Real[Any, "*batch 4"],
    width: int | float,
    height: int | float,
    *,
    half_extent: float = 0.5,
) -> tuple[Float[Any, "*batch 2"], Float[Any, "*batch 2"]]:
    """Centres and sizes of detected boxes, in the units of a demonstration set.

    The origin is the middle of the picture, x goes right and y goes up. `gril demos import-videos`
    converts with the same numbers, so a reward that was learned from such a set can be used with a
    detector's boxes. Arrays of NumPy give arrays of NumPy; those of JAX can be traced.

    >>> center, size = boxes_from_pixels(jnp.array([[0.0, 0.0, 320.0, 240.0]]), 640, 480)
    >>> center.tolist(), size.tolist()
    ([[-0.25, 0.1875]], [[0.5, 0.375]])

    Args:
      boxes: x0, y0, x1, y1 in pixels, with (0, 0) at the top left corner and y down.
      width, height: of the picture, pixels.
      half_extent: half the picture's width in world units, as the set's header has it. The default
        measures in widths of the picture.

    Returns:
      Box centres, and widths and heights, float32. A box that holds NaN gives NaN, which the
      learned reward takes for an object that is not seen.

    Raises:
      ShapeError: the last axis has not four numbers.
      ConfigError: `width`, `height` or `half_extent` is not positive.
    """
    for name, value in {"width": width, "height": height, "half_extent": half_extent}.items():
        if not value > 0:
            raise ConfigError(f"{name} is {value}; it must be positive.")
    xp = boxes.__array_namespace__() if hasattr(boxes, "__array_namespace__") else jnp
    boxes = xp.asarray(boxes)
    if boxes.shape[-1:] != (4,):
        raise ShapeError(f"boxes has shape {boxes.shape}; its last axis must be x0, y0, x1, y1.")
    scale = width / (2 * half_extent)
    low, high = boxes[..., :2], boxes[..., 2:]
    center = ((low + high) / 2 - xp.asarray([width / 2, height / 2])) / scale
    center = center * xp.asarray([1.0, -1.0])
    return center.astype(xp.float32), ((high - low) / scale).astype(xp.float32)
