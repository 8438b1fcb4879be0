"""Symmetries of videos: pixels move as the boxes that they show."""

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.encoders import resnet
from gril_jax.pretraining import batch
from gril_jax.types import DemoBatch

SIDE = 9


def _marked(center):
    """Videos (V, F, P, P, 3) that are black but for a pixel at a point in [-1, 1] (V, F, 2)."""
    column = np.rint((center[..., 0] + 1) / 2 * (SIDE - 1)).astype(int)
    row = np.rint((1 - center[..., 1]) / 2 * (SIDE - 1)).astype(int)
    frames = np.zeros((*center.shape[:2], SIDE, SIDE, 3), np.uint8)
    for v, f in np.ndindex(center.shape[:2]):
        frames[v, f, row[v, f], column[v, f]] = (10, 20, 30)
    return jnp.asarray(frames)


def _boxes(center):
    videos, frames, _ = center.shape
    return DemoBatch(
        center=jnp.asarray(center[:, :, None], jnp.float32),
        size=jnp.full((videos, frames, 1, 2), 0.1),
        label=jnp.zeros((videos, 1), int),
        is_robot=jnp.zeros((videos, 1), bool),
        present=jnp.ones((videos, 1), bool),
        length=jnp.full(videos, frames),
    )


def test_frames_are_turned_as_the_boxes_are_from_the_same_key():
    rng = np.random.default_rng(0)
    center = rng.integers(-4, 5, (40, 3, 2)) / 4  # on the grid of pixels
    key = jax.random.key(1)
    turned = batch.turn(key, _boxes(center))
    found = resnet.turn(key, _marked(center))
    np.testing.assert_array_equal(found, _marked(np.asarray(turned.center)[:, :, 0]))


def test_all_eight_symmetries_come_up_and_each_holds_for_a_whole_video():
    frames = jax.random.randint(jax.random.key(0), (1, 1, 5, 5, 3), 0, 256).astype(jnp.uint8)
    same = jnp.tile(frames, (200, 2, 1, 1, 1))
    found = np.asarray(jax.jit(resnet.turn)(jax.random.key(2), same))
    np.testing.assert_array_equal(found[:, 0], found[:, 1])
    kinds = {video.tobytes() for video in found[:, 0]}
    square = np.asarray(frames)[0, 0]
    wanted = {
        np.ascontiguousarray(np.rot90(image, k)).tobytes()
        for image in (square, square[:, ::-1])
        for k in range(4)
    }
    assert kinds == wanted
    assert len(wanted) == 8
