"""How the learned rewards of Table I look before a policy has them: along demonstrations.

    wanted = get_ready(rows, demos, num_classes, run, pool)     # compiles in the background
    profiles(wanted, rewards, run, progress)

Graph encoders only. Shapes use S for the encoders of a row.
"""

from collections.abc import Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import setup
from gril_jax.experiments.pipeline.demonstrations import Demonstrations
from gril_jax.experiments.sweeps.rewards import LearnedReward, reward_key
from gril_jax.experiments.sweeps.rows import Row

from gril_jax import reward
from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.metrics.cycles import two_way_cycle_consistency
from gril_jax.pretraining import pretrain
from gril_jax.runs.progress import Progress
from gril_jax.runs.run_dir import RunDir
from gril_jax.types import DemoBatch

__all__ = ["Wanted", "get_ready", "measure", "profiles", "program"]


class Wanted(NamedTuple):
    """The rewards of a cell, and the programs for them, which are being compiled."""

    cell: int
    rows: list[Row]
    batches: list[DemoBatch]  # those kept aside, then the failures if there are any
    ready: Future[list[Any]]  # a program for each


def get_ready(
    rows: Sequence[Row], demos: Demonstrations, num_classes: int, run: RunDir, pool: Executor
) -> list[Wanted]:
    """Begin to compile, in a pool, what is not among the run's phases.

    Args:
      rows: of which those of one cell have encoders of one shape.
      demos: of which those kept aside, and failures if there are any, are used.
      num_classes: of objects.
      run: keeps what is found.
      pool: to compile in.
    """
    cells = dict.fromkeys(row.cell for row in rows)
    left = [cell for cell in cells if run.finished_phase(f"profiles-{cell}") is None]
    splits = ["validation", *(["failure"] if demos.names["failure"] else [])]
    batches = [demos.batch(split) for split in splits] if left else []
    begun: dict[Any, Future[list[Any]]] = {}
    found = []
    for cell in left:
        members = [row for row in rows if row.cell == cell]
        config = members[0].config
        same = (setup.pretrain_config(config, num_classes), len(members))
        if same not in begun:
            begun[same] = pool.submit(_compiled, config, num_classes, len(members), batches)
        found.append(Wanted(cell, members, batches, begun[same]))
    return found


def program(static: pretrain.Static):
    """Jitted: (S rewards, hyper, demonstrations) -> two-way cycle consistency of each, rewards."""

    @jax.jit
    def embed(params: reward.RewardParams, hyper: pretrain.Hyper, batch: DemoBatch):
        latents = jax.vmap(lambda p: pretrain.embed(p.encoder, batch, hyper, static))(params)
        cycle = jax.vmap(lambda x: two_way_cycle_consistency(x, batch.length))(latents)
        return cycle, jax.vmap(reward.latent_reward)(params, latents)

    return embed


def _compiled(config: RunConfig, num_classes: int, count: int, batches: Sequence[DemoBatch]):
    with ahead.tracing():
        blank = setup.blank_reward(config, num_classes)
        params = jax.eval_shape(lambda: jax.tree.map(lambda x: jnp.stack([x] * count), blank))
        embed = program(setup.pretrain_config(config, num_classes))
        hyper = setup.pretrain_hyper(config)
        lowered = [embed.lower(params, hyper, batch) for batch in batches]
    return [compiled(one) for one in lowered]


def profiles(
    wanted: Sequence[Wanted],
    rewards: Mapping[Hashable, LearnedReward],
    run: RunDir,
    progress: Progress,
) -> None:
    """`measure` for each cell, as a phase of the run that is named after the cell."""
    if not wanted:
        return
    phase = progress.phase("reward profiles", total=len(wanted), unit="rows")
    for done, (cell, members, batches, ready) in enumerate(wanted, 1):
        found = [rewards[reward_key(row.config)] for row in members]
        hyper = setup.pretrain_hyper(members[0].config)
        run.finish_phase(f"profiles-{cell}", measure(ready.result(), found, hyper, batches))
        phase.update(done)


def measure(
    programs: Sequence[Any],
    found: Sequence[LearnedReward],
    hyper: pretrain.Hyper,
    batches: Sequence[DemoBatch],
) -> dict[str, list[Any]]:
    """Cycle consistency of each encoder, and rewards along demonstrations of the first.

    Args:
      programs: one for each batch, from `program`, jitted or compiled.
      found: a row's S rewards, which differ in their seeds alone.
      hyper: of the row.
      batches: demonstrations kept aside, then failures if there are any.

    Returns:
      `cycle`: two-way cycle consistency on demonstrations kept aside, S shares.
      `success`, `failure`: a list of rewards for each demonstration, with three decimals.
    """
    params = jax.tree.map(lambda *x: jnp.stack(x), *(one.params for one in found))
    cycles, traces = [], []
    for embed, batch in zip(programs, batches, strict=True):
        cycle, rewards = embed(params, hyper, batch)
        one = np.asarray(rewards[0], float).round(3)
        cycles.append(cycle.tolist())
        traces.append([values[:n].tolist() for values, n in zip(one, batch.length, strict=True)])
    failure = traces[1] if len(traces) > 1 else []
    return {"cycle": cycles[0], "success": traces[0], "failure": failure}
