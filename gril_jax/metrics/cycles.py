"""Two-way cycle consistency: do nearest neighbours lead back to where they began?

The share of frames that come back to within one frame of themselves, by hard nearest neighbours
(Aytar et al., NeurIPS 2018; XIRL evaluates its latents so). Everything can be jitted. Shapes use
B for videos, T for frames (padded to a common length) and D for the latent.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


def two_way_cycle_consistency(
    latents: Float[Array, "B T D"], length: Int[Array, "B"] | None = None, *, tolerance: int = 1
) -> Float[Array, ""]:
    """Share of frames that come back from another video, mean over all ordered pairs.

    >>> twice = jnp.tile(jnp.arange(4.0)[:, None], (2, 1, 1))  # a video and itself
    >>> two_way_cycle_consistency(twice, tolerance=0)
    Array(1., dtype=float32)

    Args:
      latents: of each video's frames.
      length: frames before padding; all if left out.
      tolerance: how many frames off still counts as back.

    Returns:
      In [0, 1]; 0 if there is no pair of videos with at least one frame each.
    """
    length = _lengths(latents, length)
    nearest = nearest_frames(latents, length)

    def from_query(u):  # to every other video and back
        back = jnp.take_along_axis(nearest[:, u], nearest[u], axis=1)
        share = _share(_near_home(back, tolerance), length[u])
        return share, (length > 0) & (length[u] > 0) & (jnp.arange(len(length)) != u)

    return _mean(*jax.lax.map(from_query, jnp.arange(len(length))))


def nearest_frames(
    latents: Float[Array, "B T D"], length: Int[Array, "B"] | None = None
) -> Int[Array, "B B T"]:
    """Index of the nearest frame in each video, for each frame of each video.

    Entry (u, v, t) is the frame of v nearest to frame t of u, by squared distance; the first if
    several are.

    >>> videos = jnp.array([[[0.0], [1.0], [2.0]], [[2.1], [1.1], [0.1]]])  # one backwards
    >>> nearest_frames(videos)[0, 1].tolist()
    [2, 1, 0]
    """
    length = _lengths(latents, length)
    valid = jnp.arange(latents.shape[1]) < length[:, None]
    keys = jnp.where(valid[..., None], latents, 0.0)
    squares = jnp.sum(jnp.square(keys), axis=-1)

    def pair(query, key, square, valid):
        distance = square - 2.0 * jnp.matmul(query, key.T, precision="highest")
        return jnp.argmin(jnp.where(valid, distance, jnp.inf), axis=-1).astype(jnp.int32)

    def from_query(query):
        return jax.vmap(pair, in_axes=(None, 0, 0, 0))(query, keys, squares, valid)

    return jax.lax.map(from_query, keys)


def _lengths(latents, length) -> Int[Array, "B"]:
    num_videos, num_frames, _ = latents.shape
    return jnp.full(num_videos, num_frames) if length is None else length


def _near_home(back, tolerance) -> Bool[Array, "*batch T"]:
    return jnp.abs(back - jnp.arange(back.shape[-1])) <= tolerance


def _share(home, length) -> Float[Array, "*batch"]:
    counted = home & (jnp.arange(home.shape[-1]) < length)
    return jnp.sum(counted, axis=-1) / jnp.maximum(length, 1)


def _mean(share, counted) -> Float[Array, ""]:
    return jnp.sum(jnp.where(counted, share, 0.0)) / jnp.maximum(jnp.sum(counted), 1)
