"""Loss of encoder training: alignment in time plus reconstruction (Eq. 6 of the paper).

The table `ALIGNMENTS` names the losses that align videos in time: functions of one batch.

Shapes use V for the videos of a batch, T for the frames of a video, F for those sampled from it, N
for objects, H for the width of a node embedding and D for the latent.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from gril_jax.config.tables import ALIGNMENTS, find
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import NodeConfig, Params
from gril_jax.encoders.ensemble import num_members
from gril_jax.errors import ConfigError
from gril_jax.graphs.scene import scene_graph
from gril_jax.losses import (
    decode,
    decode_graph,
    heads,
    mean_consistency,
    reconstruction,
    soft_dtw_divergence,
    stochastic_consistency,
)
from gril_jax.losses.reconstruction import init as init_node_decoder
from gril_jax.losses.reconstruction import init_graph as init_graph_decoder
from gril_jax.types import DemoBatch, Nodes

from .options import Hyper, PixelStatic, Static


class Terms(NamedTuple):
    """The parts of the loss, before lambda."""

    consistency: Float[Array, ""]  # squared error of normalised time, soft-DTW, or both
    agreement: Float[Array, ""]  # see `gril_jax.losses.mean_consistency`
    reconstruction: Float[Array, ""]


def init_decoder(key: PRNGKeyArray, config: Static, num_nodes: int) -> Params:
    """Initial parameters of the decoder in the config. The key is consumed."""
    if config.decoder == "graph":
        return init_graph_decoder(key, config.encoder, num_nodes=num_nodes)
    return init_node_decoder(key, config.encoder)


def latents(
    params: Params,
    demo: DemoBatch,
    active: Bool[Array, "T N"],
    frames: Int[Array, "F"],
    hyper: Hyper,
    config: Static,
) -> tuple[Float[Array, "F D"], Float[Array, "F N H"] | None, Nodes]:
    """Latents, node embeddings and nodes of some frames of one demonstration.

    An encoder that does not embed nodes, or an ensemble, gives None for them. In frames that are
    played backwards, what has moved by then still counts as moved.
    """
    seen = jax.lax.cummax(frames) if config.rewind > 0 else frames

    def one(center, size, active):
        graph = scene_graph(center, size, demo.label, demo.is_robot, active, demo.present)
        if num_members(config.encoder) > 1 or not isinstance(config.encoder, NodeConfig):
            found = encoder.apply(params, graph, config.encoder, alpha=hyper.alpha, form="square")
            return found, None, graph.nodes
        nodes = encoder.node_embeddings(params, graph, config.encoder, form="square")
        latent = encoder.readout(params, nodes, graph, config.encoder, alpha=hyper.alpha)
        return latent, nodes, graph.nodes

    return jax.vmap(one)(demo.center[frames], demo.size[frames], active[seen])


def terms(
    encoder_params: Params,
    decoder_params: Params,
    head: heads.Head | None,
    key: PRNGKeyArray,
    demos: DemoBatch,
    active: Bool[Array, "V T N"],
    frames: Int[Array, "V F"],
    valid: Bool[Array, "V F"],
    hyper: Hyper,
    config: Static,
    stages: Float[Array, "V T"] | None = None,
) -> Terms:
    """The loss of a batch of videos, term by term.

    `frames` are samples of each video, in the order in which they are played; `valid` are those
    that are not padding. `stages` are those of `gril_jax.pretraining.stages`, for a head that
    learns from them. The key, of whatever is sampled, is consumed.

    Raises:
      ConfigError: as for `aligned`.
    """

    def video(demo, active, frames):
        found, embeddings, nodes = latents(encoder_params, demo, active, frames, hyper, config)
        decoded = found if config.decoder == "graph" else embeddings
        return found, jax.vmap(lambda *x: _rebuild(decoder_params, *x, config))(decoded, nodes)

    found, rebuilt = jax.vmap(video)(demos, active, frames)
    times = frames / demos.length[:, None]
    if stages is not None:
        stages = jnp.take_along_axis(stages, frames, axis=1)
    clips = heads.Clip(found, frames, demos.length, valid, stages)
    consistency, agreement = aligned(key, found, times, valid, hyper, config, head, clips)
    counted = valid[:, :, None] & _decodable(demos, config)[:, None, :]
    total = jnp.sum(jnp.where(counted, rebuilt, 0.0))
    return Terms(
        consistency, agreement, total / jnp.maximum(jnp.sum(counted), 1).astype(total.dtype)
    )


def _rebuild(params, decoded, nodes, config) -> Float[Array, "N"]:
    if config.decoder == "graph":
        num_nodes = nodes.label.shape[0]
        box, logits = decode_graph(params, decoded, config.encoder, num_nodes=num_nodes)
    else:
        box, logits = decode(params, decoded, config.encoder)
    return reconstruction(box, logits, nodes, length_unit=config.encoder.length_unit)


def _decodable(demos, config) -> Bool[Array, "V N"]:
    """Objects to reconstruct; from the latent, only those that are pooled into it."""
    if config.decoder == "graph" and not config.encoder.pool_robot:
        return demos.present & ~demos.is_robot
    return demos.present


class Frames(NamedTuple):
    """The frames of a batch of videos, and what a loss may use."""

    key: PRNGKeyArray
    latents: Float[Array, "V F D"]
    times: Float[Array, "V F"]  # as shares of their video
    valid: Bool[Array, "V F"]
    plain: Float[Array, ""]  # cycle-consistency through all videos, computed in any case
    hyper: Hyper
    head: heads.Head | None = None
    clips: heads.Clip | None = None  # of each video, for the head


def aligned(
    key: PRNGKeyArray,
    latents: Float[Array, "V F D"],
    times: Float[Array, "V F"],
    valid: Bool[Array, "V F"],
    hyper: Hyper,
    config: Static | PixelStatic,
    head: heads.Head | None = None,
    clips: heads.Clip | None = None,
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The loss that the options name, and the time agreement that helps it to begin.

    Raises:
      ConfigError: the options name a method that predicts progress, and `head` is missing.
    """
    chosen = ALIGNMENTS[config.consistency]
    if chosen.head and head is None:
        raise ConfigError(
            f"consistency is {config.consistency!r}, which needs a head, but there is none: an "
            "encoder of pictures has none, and one of boxes has the head that `init` made."
        )
    how = dict(form=chosen.form, temperature=hyper.temperature, similarity=chosen.similarity)
    plain, agreement = mean_consistency(latents, times, valid, **how)
    frames = Frames(key, latents, times, valid, plain, hyper, head, clips)
    losses = [find(name)(frames) for name in chosen.losses]
    return sum(losses[1:], start=losses[0]), agreement


def cycle(frames: Frames) -> Float[Array, ""]:
    """Temporal cycle-consistency of every frame through every other video."""
    return frames.plain


def sampled_cycle(frames: Frames) -> Float[Array, ""]:
    """Temporal cycle-consistency of as many randomly sampled cycles."""
    temperature = frames.hyper.temperature
    return stochastic_consistency(*frames[:4], temperature=temperature)


def warping(frames: Frames) -> Float[Array, ""]:
    """Soft-DTW divergence per frame, mean over all pairs of videos."""
    latents = frames.latents
    one, other = jnp.triu_indices(latents.shape[0], 1)
    length = jnp.sum(frames.valid, axis=1)  # valid frames come first
    divergence = soft_dtw_divergence(
        latents[one], latents[other], length[one], length[other], gamma=frames.hyper.gamma
    )
    count = jnp.maximum(length[one] + length[other], 1)
    return frames.hyper.soft_dtw_weight * jnp.mean(divergence / count)


def of_head(frames: Frames) -> Float[Array, ""]:
    """The loss of a head that predicts progress, mean over videos."""
    keys = jax.random.split(frames.key, frames.latents.shape[0])
    return jnp.mean(jax.vmap(frames.head.loss)(keys, frames.clips))
