"""The learned rewards of Table I along demonstrations, before a policy has them.

Graph encoders only. Shapes use S for the encoders of a row.
"""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from gril_jax.experiments.pipeline import setup
from gril_jax.experiments.pipeline.demonstrations import Demonstrations
from gril_jax.experiments.tables.measures import Measure, blank_rewards, stacked
from gril_jax.experiments.tables.rewards import LearnedReward

from gril_jax import reward
from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.metrics.order import two_way_cycle_consistency
from gril_jax.pretraining import pretrain
from gril_jax.types import DemoBatch


def profiles(demos: Demonstrations) -> Measure:
    """Cycle consistency and rewards as a measure, on demonstrations kept aside and on failures."""
    num_classes = len(demos.demo_set.classes)
    splits = ["validation", *(["failure"] if demos.names["failure"] else [])]
    batches = [demos.batch(split) for split in splits]
    same = lambda config: setup.pretrain_config(config, num_classes)  # noqa: E731

    def compile_for(config: RunConfig, count: int):
        with ahead.tracing():
            params, embed = blank_rewards(config, num_classes, count), program(same(config))
            hyper = setup.pretrain_hyper(config)
            lowered = [embed.lower(params, hyper, batch) for batch in batches]
        return [compiled(one) for one in lowered]

    def found(programs, config, rewards):
        return measure(programs, rewards, setup.pretrain_hyper(config), batches)

    return Measure("profiles", found, same, compile_for)


def program(static: pretrain.Static):
    """Jitted program: (S rewards, hyper, demonstrations) -> two-way cycle consistency, rewards."""

    @jax.jit
    def embed(params: reward.RewardParams, hyper: pretrain.Hyper, batch: DemoBatch):
        latents = jax.vmap(lambda p: pretrain.embed(p.encoder, batch, hyper, static))(params)
        cycle = jax.vmap(lambda x: two_way_cycle_consistency(x, batch.length))(latents)
        return cycle, jax.vmap(reward.latent_reward)(params, latents)

    return embed


def measure(
    programs: Sequence[Any],
    found: Sequence[LearnedReward],
    hyper: pretrain.Hyper,
    batches: Sequence[DemoBatch],
) -> dict[str, list[Any]]:
    """Cycle consistency of each encoder, and rewards along demonstrations of the first.

    The programs, from `program`, are one for each batch: demonstrations kept aside, then
    failures if there are any.

    Returns:
      `cycle`: two-way cycle consistency on demonstrations kept aside, S shares.
      `success`, `failure`: a list of rewards for each demonstration, with three decimals.
    """
    params, cycles, traces = stacked(found), [], []
    for embed, batch in zip(programs, batches, strict=True):
        cycle, rewards = embed(params, hyper, batch)
        one = np.asarray(rewards[0], float).round(3)
        cycles.append(cycle.tolist())
        traces.append([values[:n].tolist() for values, n in zip(one, batch.length, strict=True)])
    failure = traces[1] if len(traces) > 1 else []
    return {"cycle": cycles[0], "success": traces[0], "failure": failure}
