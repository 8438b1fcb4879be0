"""The temporal cycle-consistency loss of a batch of videos: the mean over all ordered pairs.

    loss = mean_cycle_consistency(latents, times, form="classification", similarity="cosine")

Shapes use B for videos, T for frames and D for the latent.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .cycle import form_options, matching_options, prepared_agreement, prepared_cycle
from .soft_neighbour import check_batch, prepare


def mean_cycle_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    *,
    at_once: bool = False,
    temperature: Float[Array, ""] | float = 1.0,
    similarity: str = "l2",
    normalize: bool | None = None,
    form: str = "regression_mse",
    huber_delta: Float[Array, ""] | float = 0.1,
    variance_weight: Float[Array, ""] | float = 0.001,
    label_smoothing: Float[Array, ""] | float = 0.1,
) -> Float[Array, ""]:
    """Mean of `cycle_consistency` over all ordered pairs of different videos: the TCC loss.

    >>> twice = 9.0 * jnp.tile(jnp.eye(4), (2, 1, 1))  # a video and itself: every frame comes home
    >>> times = jnp.tile(jnp.arange(4.0) / 4, (2, 1))
    >>> round(float(mean_cycle_consistency(twice, times, temperature=0.1)), 6)
    0.0

    Args:
      latents: of each video's frames.
      times: of those frames, see `frame_times`.
      valid: False for padding; only valid frames count.
      at_once: put all pairs through the same few products, with memory for B^2 T^2 numbers. If
        not, one query video at a time is in memory, with B T^2 numbers; faster, and in reverse
        mode only.
      temperature, similarity, normalize, form, huber_delta, variance_weight, label_smoothing: as
        for `cycle_consistency`.

    Returns:
      The mean over all valid frames of all pairs; 0 if there is none, as for a single video.
    """
    matching = matching_options(temperature, similarity, normalize)
    knobs = form_options(form, huber_delta, variance_weight, label_smoothing)

    def pair(query, time, query_valid, other, _, other_valid):
        return (prepared_cycle(query, other, time, query_valid, other_valid, matching, knobs),)

    return _mean_over_pairs(pair, latents, times, valid, matching["unit"], at_once)[0]


def mean_consistency(
    latents: Float[Array, "B T D"],
    times: Float[Array, "B T"],
    valid: Bool[Array, "B T"] | None = None,
    *,
    at_once: bool = True,
    temperature: Float[Array, ""] | float = 1.0,
    similarity: str = "l2",
    normalize: bool | None = None,
    form: str = "regression_mse",
    huber_delta: Float[Array, ""] | float = 0.1,
    variance_weight: Float[Array, ""] | float = 0.001,
    label_smoothing: Float[Array, ""] | float = 0.1,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Means of `cycle_consistency` and `time_agreement` over all ordered pairs of videos.

    Args as for `mean_cycle_consistency`, but all pairs at once unless told otherwise.
    """
    matching = matching_options(temperature, similarity, normalize)
    knobs = form_options(form, huber_delta, variance_weight, label_smoothing)

    def pair(query, time, query_valid, other, other_time, other_valid):
        masks = (query_valid, other_valid)
        return (
            prepared_cycle(query, other, time, *masks, matching, knobs),
            prepared_agreement(query, other, time, other_time, *masks, matching),
        )

    return _mean_over_pairs(pair, latents, times, valid, matching["unit"], at_once)


def _mean_over_pairs(pair, latents, times, valid, unit, at_once):
    """Mean of each of `pair`'s values over the valid frames of all ordered pairs."""
    check_batch(latents, times, valid)
    latents = prepare(latents, valid, unit=unit)
    num_videos, num_frames, _ = latents.shape
    ordered = num_videos * (num_videos - 1)
    if not ordered:
        one = jax.tree.map(lambda x: x[0], (latents, times, valid))
        return jax.tree.map(lambda x: jnp.zeros((), x.dtype), jax.eval_shape(pair, *one, *one))
    total = ordered * num_frames if valid is None else jnp.sum(_pairs_per_frame(valid))

    def errors(asked, answering):
        return jax.vmap(functools.partial(pair, *asked))(*answering)

    videos = (latents, times, valid)
    if at_once:
        others = jnp.array([[j for j in range(num_videos) if j != i] for i in range(num_videos)])
        answering = jax.tree.map(lambda x: jnp.take(x, others, axis=0, mode="clip"), videos)
        sums = jax.tree.map(jnp.sum, jax.vmap(errors)(videos, answering))
    else:

        def query(floats, valid, i):
            """Sums over one video's pairs with the others."""
            answering = (*floats, valid)
            found = errors(jax.tree.map(lambda x: x[i], answering), answering)
            other = jnp.arange(num_videos)[:, None] != i
            return [jnp.sum(jnp.where(other, x, 0.0)) for x in found]

        sums = _one_by_one(query, (latents, times), valid)
    return tuple(x / jnp.maximum(total, 1).astype(x.dtype) for x in sums)


def _one_by_one(query, floats, valid):
    """Sum of `query` over all videos, one at a time, and its gradient in the same pass.

    The sum is linear in what the queries give, so that each can be differentiated right after it
    has been computed: nothing is kept for a second pass, and nothing computed again. Only
    reverse mode; a gradient of the gradient is right, too.
    """
    count = floats[0].shape[0]
    query, known = jax.closure_convert(query, floats, valid, 0)

    def summed(one):
        def step(sums, i):
            return jax.tree.map(jnp.add, sums, one(i)), None

        shapes = jax.eval_shape(one, 0)
        zeros = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
        return jax.lax.scan(step, zeros, jnp.arange(count))[0]

    @jax.custom_vjp
    def total(floats, valid, known):
        return summed(lambda i: query(floats, valid, i, *known))

    def forward(floats, valid, known):
        def one(i):
            sums, pull = jax.vjp(lambda x, k: query(x, valid, i, *k), floats, known)
            basis = jnp.eye(len(sums), dtype=sums[0].dtype)
            return sums, [pull([*row]) for row in basis]

        return summed(one)

    def backward(slopes, change):
        pairs = zip(change, slopes, strict=True)
        scaled = [jax.tree.map(lambda x, c=c: c * x, slope) for c, slope in pairs]
        floats, known = jax.tree.map(lambda *parts: sum(parts), *scaled)
        return floats, None, known

    total.defvjp(forward, backward)
    return total(floats, valid, known)


def _pairs_per_frame(valid):
    """Number of pairs in which each frame is a query: one per other video with a valid frame."""
    filled = jnp.any(valid, axis=1)
    others = jnp.sum(filled) - filled.astype(jnp.int32)
    return jnp.where(valid, others[:, None], 0)
