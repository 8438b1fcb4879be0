"""How the learned rewards of Table I look before a policy has them: along demonstrations.

Graph encoders only. Shapes use S for the encoders of a row.
"""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import pretrain, reward
from gril_jax.cycle_metrics import two_way_cycle_consistency
from gril_jax.progress import Progress
from gril_jax.run_dir import RunDir
from gril_jax.types import DemoBatch

from . import setup
from .demonstrations import Demonstrations
from .sweep_rewards import LearnedReward, reward_key
from .sweep_rows import Row

__all__ = ["measure", "profiles"]


def profiles(
    rows: Sequence[Row],
    rewards: Mapping[Hashable, LearnedReward],
    demos: Demonstrations,
    run: RunDir,
    progress: Progress,
) -> None:
    """`measure` for each cell, as a phase of the run that is named after the cell."""
    cells = dict.fromkeys(row.cell for row in rows)
    left = [cell for cell in cells if run.finished_phase(f"profiles-{cell}") is None]
    if not left:
        return
    phase = progress.phase("reward profiles", total=len(left), unit="rows")
    for done, cell in enumerate(left, 1):
        members = [row for row in rows if row.cell == cell]
        found = [rewards[reward_key(row.config)] for row in members]
        run.finish_phase(f"profiles-{cell}", measure(members[0], found, demos))
        phase.update(done)


def measure(
    row: Row, found: Sequence[LearnedReward], demos: Demonstrations
) -> dict[str, list[Any]]:
    """Cycle consistency of each encoder, and rewards along demonstrations of the first.

    Args:
      row: one of the row's policies; their rewards differ in their seeds alone.
      found: its S rewards.
      demos: of which those kept aside, and failures if there are any, are used.

    Returns:
      `cycle`: two-way cycle consistency on demonstrations kept aside, S shares.
      `success`, `failure`: a list of rewards for each demonstration, with three decimals.
    """
    static = setup.pretrain_config(row.config, found[0].num_classes)
    hyper = setup.pretrain_hyper(row.config)
    params = jax.tree.map(lambda *x: jnp.stack(x), *(one.params for one in found))

    @jax.jit
    def embed(params: reward.RewardParams, batch: DemoBatch):
        latents = jax.vmap(lambda p: pretrain.embed(p.encoder, batch, hyper, static))(params)
        cycle = jax.vmap(lambda x: two_way_cycle_consistency(x, batch.length))(latents)
        return cycle, jax.vmap(reward.latent_reward)(params, latents)

    def traces(batch, rewards):
        one = np.asarray(rewards[0], float).round(3)
        return [values[:n].tolist() for values, n in zip(one, batch.length, strict=True)]

    aside = demos.batch("validation")
    cycle, rewards = embed(params, aside)
    failures = []
    if demos.names["failure"]:
        failed = demos.batch("failure")
        failures = traces(failed, embed(params, failed)[1])
    return {"cycle": cycle.tolist(), "success": traces(aside, rewards), "failure": failures}
