"""Temporal cycle-consistency of a batch of videos: over all ordered pairs, or random cycles.

With a cycle length of 2 and each frame of all ordered pairs once, stochastic matching is the
deterministic one. Shapes use B for videos, T for frames, D for the latent, K for cycles and L for
the videos of a cycle.
"""

import functools
from typing import Unpack

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.errors import ConfigError
from gril_jax.types import checked

from .cycle import CycleOptions, cycle_error, prepared_agreement, prepared_cycle, resolved
from .soft_neighbour import check_batch, closeness, match_weights, prepare


@checked
def mean_cycle_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    **options: Unpack[CycleOptions],
) -> Float[Array, ""]:
    """Mean of `cycle_consistency` over all ordered pairs of different videos: the TCC loss.

    >>> twice = 9.0 * jnp.tile(jnp.eye(4), (2, 1, 1))  # a video and itself: every frame comes home
    >>> times = jnp.tile(jnp.arange(4.0) / 4, (2, 1))
    >>> round(float(mean_cycle_consistency(twice, times, temperature=0.1)), 6)
    0.0

    Args:
      latents: of each video's frames.
      times: of those frames, as shares of their video: frame index / video length.
      valid: False for padding; only valid frames count.
      options: `CycleOptions`.

    Returns:
      The mean over all valid frames of all pairs; 0 if there is none, as for a single video.

    Raises:
      ShapeError: the arrays do not fit together.
      ConfigError: an option is unknown, or a value known at trace time is not positive.
    """
    return mean_consistency(latents, times, valid, **options)[0]


@checked
def mean_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    **options: Unpack[CycleOptions],
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """`mean_cycle_consistency`, and the mean squared difference between a frame's time and that of
    its soft neighbour, from the same matches.

    A cycle closes just as well if two videos agree on a scrambled order of events, and training
    does get stuck there. The second term depends on the direction of time. It is for the first
    updates only, since it also penalises a demonstrator who takes longer over one stage. Arguments
    and errors are the same.
    """
    matching, form = resolved(**options)

    def pair(query, time, query_valid, other, other_time, other_valid):
        valid = query_valid, other_valid
        cycle = prepared_cycle(query, other, time, *valid, matching, form)
        return cycle, prepared_agreement(query, other, time, other_time, *valid, matching)

    check_batch(latents, times, valid)
    latents = prepare(latents, valid, unit=matching["unit"])
    num_videos, num_frames, _ = latents.shape
    ordered = num_videos * (num_videos - 1)
    if not ordered:
        return jnp.zeros((), latents.dtype), jnp.zeros((), latents.dtype)
    total = ordered * num_frames if valid is None else jnp.sum(_pairs_per_frame(valid))

    def errors(asked, answering):
        return jax.vmap(functools.partial(pair, *asked))(*answering)

    videos = (latents, times, valid)
    others = jnp.array([[j for j in range(num_videos) if j != i] for i in range(num_videos)])
    answering = jax.tree.map(lambda x: jnp.take(x, others, axis=0, mode="clip"), videos)
    cycle, agreement = jax.tree.map(jnp.sum, jax.vmap(errors)(videos, answering))
    return tuple(x / jnp.maximum(total, 1).astype(x.dtype) for x in (cycle, agreement))


def _pairs_per_frame(valid):
    """Number of pairs in which each frame is a query: one per other video with a valid frame."""
    filled = jnp.any(valid, axis=1)
    others = jnp.sum(filled) - filled.astype(jnp.int32)
    return jnp.where(valid, others[:, None], 0)


@checked
def draw_cycles(
    key: PRNGKeyArray, valid: Bool[Array, "B T"], *, num_cycles: int, cycle_length: int = 2
) -> tuple[Int[Array, "K L"], Int[Array, "K"]]:
    """Samples cycles: distinct videos in random order, and a valid frame of the first of them.

    Videos without a valid frame are sampled only if the others do not suffice. The key is consumed.

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


@checked
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


@checked
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
