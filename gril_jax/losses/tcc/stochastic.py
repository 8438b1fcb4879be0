"""Temporal cycle-consistency by stochastic matching: random cycles through random videos.

    loss = stochastic_consistency(key, latents, frames / length[:, None], valid)

A random frame goes to its soft nearest neighbour in a second video, from there to a third, and
so on, and at last back to its own video (Dwibedi et al., CVPR 2019; as XIRL does it). With a
cycle length of 2 and all frames of all ordered pairs drawn once, this is the deterministic
matching of `gril_jax.losses.mean_cycle_consistency`. Shapes use B for videos, T for frames, D
for the latent, K for cycles and L for the videos of a cycle.
"""

from typing import Unpack

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.errors import ConfigError

from .cycle import CycleOptions, cycle_error, resolved
from .soft_neighbour import check_batch, closeness, match_weights, prepare


def draw_cycles(
    key: PRNGKeyArray, valid: Bool[Array, "B T"], *, num_cycles: int, cycle_length: int = 2
) -> tuple[Int[Array, "K L"], Int[Array, "K"]]:
    """Samples cycles: distinct videos in random order, and a valid frame of the first of them.

    Videos without a valid frame are drawn only if the others do not suffice. The key is consumed.

    >>> videos, frames = draw_cycles(jax.random.key(0), jnp.ones((3, 5), bool), num_cycles=4)
    >>> videos.shape, frames.shape
    ((4, 2), (4,))

    Args:
      key: of the draw.
      valid: False for padding.
      num_cycles: K.
      cycle_length: L, from 1 to B; with 1 a frame looks for itself in its own video.

    Raises:
      ConfigError: a number is out of range.
    """
    num_videos, num_frames = valid.shape
    if not 1 <= cycle_length <= num_videos:
        raise ConfigError(
            f"cycle_length is {cycle_length}; it must be from 1 to the number of videos, "
            f"{num_videos}."
        )
    if num_cycles < 1:
        raise ConfigError(f"num_cycles is {num_cycles}; it must be at least 1.")
    video_key, frame_key = jax.random.split(key)
    order = jax.random.uniform(video_key, (num_cycles, num_videos))
    order = jnp.where(jnp.any(valid, axis=1), order, 2.0)
    videos = jnp.argsort(order, axis=1)[:, :cycle_length]
    chance = jax.random.uniform(frame_key, (num_cycles, num_frames))
    return videos, jnp.argmax(jnp.where(valid[videos[:, 0]], chance, -1.0), axis=1)


def sampled_cycle_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    videos: Int[Array, "K L"],
    frames: Int[Array, "K"],
    valid: Bool[Array, "B T"] | None = None,
    **options: Unpack[CycleOptions],
) -> Float[Array, "K"]:
    """Error of each given cycle, not averaged.

    About T cycles at a time are in memory, with T^2 D numbers; the gradient recomputes them.

    Args:
      latents: of each video's frames.
      times: of those frames, as shares of their video.
      videos: the videos of each cycle, in order; the way back to the first is added.
      frames: the frame of the first video that each cycle starts from.
      valid: False for padding, which is never matched.
      options: `CycleOptions`.

    Returns:
      One value per cycle; 0 if it starts at padding or passes a video without a valid frame.
    """
    check_batch(latents, times, valid)
    matching, form = resolved(**options)
    latents = prepare(latents, valid, unit=matching["unit"])

    def mask(video):
        return None if valid is None else valid[video]

    def cycle(inputs):
        path, frame = inputs
        position = latents[path[0], frame][None]
        for stop in range(1, path.shape[0]):
            keys, counted = latents[path[stop]], mask(path[stop])
            weights = match_weights(closeness(position, keys, **matching), counted)
            position = jnp.matmul(weights, keys, precision="highest")
        back = closeness(position, latents[path[0]], **matching)
        return cycle_error(back, times[path[0]], frame[None], mask(path[0]), **form)[0]

    # The chunk is what one pair of videos has in deterministic matching.
    errors = jax.lax.map(
        jax.checkpoint(cycle), (videos, frames), batch_size=min(latents.shape[1], len(frames))
    )
    return errors if valid is None else jnp.where(_closed(videos, frames, valid), errors, 0.0)


def stochastic_consistency(
    key: PRNGKeyArray,
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    *,
    num_cycles: int | None = None,
    cycle_length: int = 2,
    **options: Unpack[CycleOptions],
) -> Float[Array, ""]:
    """Mean of `sampled_cycle_consistency` over random cycles. The key is consumed.

    Args:
      key: of the draw; another for each update.
      latents: of each video's frames.
      times: of those frames, as shares of their video.
      valid: False for padding; only cycles through valid frames count.
      num_cycles: how many; B T if left out, as in XIRL.
      cycle_length: how many videos a cycle visits, its own included.
      options: `CycleOptions`.

    Returns:
      The mean over all cycles that count; 0 if there is none.

    Raises:
      ConfigError: fewer than one cycle, or cycles of fewer than two videos.
    """
    check_batch(latents, times, valid)
    num_cycles = times.size if num_cycles is None else num_cycles
    present = jnp.ones(times.shape, bool) if valid is None else valid
    videos, frames = draw_cycles(key, present, num_cycles=num_cycles, cycle_length=cycle_length)
    errors = sampled_cycle_consistency(latents, times, videos, frames, valid, **options)
    closed = jnp.maximum(jnp.sum(_closed(videos, frames, present)), 1)
    return jnp.sum(errors) / closed.astype(errors.dtype)


def _closed(videos, frames, valid) -> Bool[Array, "K"]:
    """True for cycles that start at a valid frame and find one in every video."""
    return valid[videos[:, 0], frames] & jnp.all(jnp.any(valid, axis=1)[videos], axis=1)
