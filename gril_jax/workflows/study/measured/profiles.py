"""Two-way cycle consistency of encoders, and rewards along demonstrations kept aside and failures.

Shapes use S for rewards.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from gril_jax import reward
from gril_jax.config import RunConfig
from gril_jax.metrics.order import two_way_cycle_consistency
from gril_jax.pretraining import pretrain
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.demonstrations import Demonstrations

from ..rewards import TrainedReward, task_key
from .measure import Measure, num_classes, stacked


def measure(gather: Callable[[RunConfig], Demonstrations]) -> Measure:
    """Cycle consistency and rewards, along demonstrations of each row's own set."""

    def batches(config: RunConfig) -> list[DemoBatch]:
        demos = gather(config)
        splits = ["validation", *(["failure"] if demos.names["failure"] else [])]
        return [demos.batch(split) for split in splits]

    def static(config: RunConfig) -> pretrain.Static:
        return setup.pretrain_config(config, num_classes(config.env))

    def same(config):
        return task_key(config), config.demos, static(config)

    def lower(config, params):
        embed, hyper = program(static(config)), setup.pretrain_hyper(config)
        return [embed.lower(params, hyper, batch) for batch in batches(config)]

    def found(programs, config, rewards):
        return figures(programs, rewards, setup.pretrain_hyper(config), batches(config))

    return Measure("profiles", found, same, lower)


def program(static: pretrain.Static):
    """Jitted program: (S rewards, hyper, demonstrations) -> two-way cycle consistency, rewards."""

    @jax.jit
    def embed(params: reward.RewardParams, hyper: pretrain.Hyper, batch: DemoBatch):
        latents = jax.vmap(lambda p: pretrain.embed(p.encoder, batch, hyper, static))(params)
        cycle = jax.vmap(lambda x: two_way_cycle_consistency(x, batch.length))(latents)
        return cycle, jax.vmap(reward.latent_reward)(params, latents)

    return embed


def figures(
    programs: Sequence[Any],
    found: Sequence[TrainedReward],
    hyper: pretrain.Hyper,
    batches: Sequence[DemoBatch],
) -> dict[str, list[Any]]:
    """Two-way cycle consistency of each encoder, and rewards along demonstrations of the first.

    The programs, from `program`, are one for each batch: demonstrations kept aside, for `cycle` and
    `success`, then failures if there are any. Rewards are lists with three decimals.
    """
    params, cycles, traces = stacked(found), [], []
    for embed, batch in zip(programs, batches, strict=True):
        cycle, rewards = embed(params, hyper, batch)
        one = np.asarray(rewards[0], float).round(3)
        cycles.append(cycle.tolist())
        traces.append([values[:n].tolist() for values, n in zip(one, batch.length, strict=True)])
    failure = traces[1] if len(traces) > 1 else []
    return {"cycle": cycles[0], "success": traces[0], "failure": failure}
