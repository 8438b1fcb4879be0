"""The paper's Table I and Figure 2: one task, one learner, one budget, and thirteen rewards.

    gril table1                               five seeds; sized for a GPU
    gril table1 --demos HUMAN --seeds 10
    gril table1 --quick                       two rows and two seeds of one block, on a laptop
    gril table1 --join RUN,RUN --out FOLDER      runs with different rows as one table

For each row and seed an encoder is trained where the row learns a reward, audited, and a policy is
trained with that reward. Writes `table1.md` and `table1.csv` (a line a policy) after each program,
`figure2.png` and `report.html` at the end, or when `gril report RUN` draws a run that was cut off.
"""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from matplotlib.figure import Figure

from gril_jax import reward
from gril_jax.metrics.order import two_way_cycle_consistency
from gril_jax.pretraining import pretrain
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import setup
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study.curves import learning_curves
from gril_jax.workflows.study.measures import Measure, audit, audited_tasks, stacked
from gril_jax.workflows.study.results import Found, Table
from gril_jax.workflows.study.rewards import TrainedReward
from gril_jax.workflows.study.written import by_row

from .columns import COLUMNS, REWARD, STARTS, SUCCESS, page, policy, text
from .rows import ROWS, Settings


def profiles(demos: Demonstrations) -> Measure:
    """Cycle consistency and rewards as a measure, on demonstrations kept aside and on failures."""
    num_classes = len(demos.demo_set.classes)
    splits = ["validation", *(["failure"] if demos.names["failure"] else [])]
    batches = [demos.batch(split) for split in splits]

    def same(config):
        return setup.pretrain_config(config, num_classes)

    def lower(config, params):
        embed, hyper = program(same(config)), setup.pretrain_hyper(config)
        return [embed.lower(params, hyper, batch) for batch in batches]

    def found(programs, config, rewards):
        return measure(programs, rewards, setup.pretrain_hyper(config), batches)

    return Measure("profiles", found, same, lower, num_classes)


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


def _measures(config, settings: Settings, demos):
    """Audits from the first kind of start, and rewards along demonstrations."""
    work = {"starts": settings.starts, "ascents": settings.ascents}
    return [audit(audited_tasks(config.env, STARTS[:1]), **work), profiles(demos)]


def _plan(rows, settings: Settings, programs):
    audited_tasks(rows[0].config.env)  # refuses what cannot be audited
    return programs(rows, starts=STARTS)


def _summary(found: Found) -> dict[str, Any]:
    rows: dict[str, dict[str, float]] = {}
    for name in SUCCESS:
        for row, values in by_row(found.lines, name).items():
            rows.setdefault(row, {})[name] = sum(values.tolist()) / len(values)
    starts = {variant: counted._asdict() for variant, counted in found.starts.items()}
    about = {name: x for name, x in found.about.items() if name != "started"}  # no clocks
    return {"rows": rows, "starts": starts} | about


def _figure(found: Found) -> Figure | None:
    score = f"success_{STARTS.many}_sampled"
    return learning_curves(found.names, found.curves, score=score) if found.curves else None


TABLE = Table(
    "table1",
    columns=lambda lines: COLUMNS,
    text=text,
    figure=_figure,
    picture="figure2.png",
    page=page,
    settings=Settings,
    plan=_plan,
    policy=policy,
    measured={"audit": REWARD[2:], "profiles": REWARD[1:2]},
    measures=_measures,
    order=[*ROWS],
    summary=_summary,
)
