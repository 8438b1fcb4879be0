"""Failures as teachers: where a failed attempt ends must be further from the goal than a margin.

A failure is labelled at its end only. Nobody says where it went wrong, so nothing is learned from
the frames before. "Good Embodied Reward Models Need Bad Behavior Data" (arXiv 2606.01036) argues
that rewards should learn from failures, too.

Shapes use F for failures, V for the videos of a batch and N for objects.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from gril_jax.audit.scene_reward import Scene
from gril_jax.encoders import encoder
from gril_jax.encoders.encoder import Params
from gril_jax.graphs.scene import safe_norm, scene_graph
from gril_jax.types import DemoBatch

from .options import Hyper, Static


def nearness(
    params: Params,
    demos: DemoBatch,
    active: Bool[Array, "V T N"],
    failed: DemoBatch,
    failed_active: Bool[Array, "F T N"],
    hyper: Hyper,
    config: Static,
) -> Float[Array, ""]:
    """Mean square of how much nearer than `failure_margin` failures end to the goal.

    The goal is the mean of the last latents of a batch's successes, or the nearest of them with
    several `config.goals`. Distances are in units of the mean distance of their first latents.
    """

    def latents(batch, bits, at):
        def one(batch, bits, at):
            scene = Scene(batch.center[at], batch.size[at], batch.label, batch.is_robot, bits[at])
            graph = scene_graph(*scene, batch.present)
            return encoder.apply(params, graph, config.encoder, alpha=hyper.alpha, form="square")

        return jax.vmap(one)(batch, bits, at)

    last = latents(demos, active, demos.length - 1)
    first = latents(demos, active, jnp.zeros_like(demos.length))
    ends = latents(failed, failed_active, failed.length - 1)
    goals = last if config.goals > 1 else last.mean(axis=0, keepdims=True)
    away = lambda x: jnp.min(safe_norm(x[:, None] - goals), axis=1)  # noqa: E731
    short = hyper.failure_margin - away(ends) / jnp.maximum(jnp.mean(away(first)), 1e-6)
    return jnp.mean(jax.nn.relu(short) ** 2)
