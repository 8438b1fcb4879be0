"""The paper's Table II: how well learned rewards tell success from failure on a long task.

    gril table2 --seeds 5 --out RUN           five encoders a row; sized for a GPU
    gril table2 --quick --out RUN             two a row from fewer demonstrations, on a laptop

For each row and seed an encoder is trained. Its reward is measured along successes that no encoder
was trained on, and along failures, which train none. Writes `table2.md`, `table2.csv` (a line an
encoder) and `table2.png`. Shapes use B for recordings and T for frames.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gril_jax import reward
from gril_jax.demos.demo import Demo
from gril_jax.errors import DemoError
from gril_jax.metrics.separation import CONVENTIONS, cumulative, ratio, stage_order, success_auc
from gril_jax.report.figures.curves import spread
from gril_jax.workflows.build import learners, setup
from gril_jax.workflows.build.demonstrations import Demonstrations
from gril_jax.workflows.study.measures import TAU, Measure
from gril_jax.workflows.study.results import Found, Table
from gril_jax.workflows.study.written import (
    Column,
    Line,
    Section,
    by_row,
    markdown,
    mean_interval,
    with_paper,
)

from .rows import PAPER

# Measures of an encoder; the separation ratio first in the convention that is compared with the
# paper's.
MEASURES = (
    "rho_held", "rho_resampled", "rho_natural", "auc_final", "auc_held", "auc_resampled", "order",
)  # fmt: skip

_shares = mean_interval(middle=False)

_SECTIONS = (
    Section(
        "Mean over seeds (95 % bootstrap interval of the interquartile mean). rho (Eq. 8) is the "
        "mean |cumulative reward| of held-out successes over that of failures, lower is better. A "
        "sum depends on how long a recording is, and failures are often short. held: what a "
        "recording ends with goes on to the length of the longest, as in an episode of fixed "
        "length; resampled: each is stretched to that length; natural: as it is. The paper does "
        "not say which is its own.",
        (
            Column("paper", "paper's rho"),
            Column("rho_held", "rho, held", _shares),
            Column("rho_resampled", "rho, resampled", _shares),
            Column("rho_natural", "rho, natural", _shares),
        ),
    ),
    Section(
        "AUC: how often a success is above a failure, by the reward of its last frame or by its "
        "held sum (that of the resampled sum is in the CSV). Order of stages: Somers' D of the "
        "reward with the number of stages done, held-out successes; tau: Kendall's tau of nearest "
        "neighbours.",
        (
            Column("auc_final", "AUC, last reward", _shares),
            Column("auc_held", "AUC, held sum", _shares),
            Column("order", "order of stages", _shares),
            Column("tau", "tau", _shares),
        ),
    ),
)


def kinds(lines: Sequence[Line]) -> list[str]:
    """Kinds of failure, in order of appearance."""
    return list(dict.fromkeys(k[4:] for line in lines for k in line if k.startswith("auc ")))


def columns(lines: Sequence[Line]) -> list[str]:
    """The columns of the CSV: those of each kind of failure come last."""
    each = [f"{what} {kind}" for kind in kinds(lines) for what in ("auc", "last")]
    return ["row", "seed", *MEASURES, "tau", "last success", *each]


def text(found: Found) -> str:
    """All measures with the paper's ratio, and the kinds of failure, as Markdown."""
    lines, write = with_paper(found.lines, PAPER, 3), mean_interval(digits=2, middle=False)
    failures = Section(
        "AUC of the last reward, successes against failures of each kind:",
        [Column(f"auc {kind}", kind, write) for kind in kinds(lines)],
    )
    rows = [line["row"] for line in lines]
    seeds = max(rows.count(row) for row in rows)
    return f"Seeds: {seeds}\n\n{markdown(lines, [*_SECTIONS, failures])}"


_LEAST = 2  # recordings of either outcome
_SPREAD = "rho of held-out recordings, held to one length; lower is better"


def _measures(config, settings, demos: Demonstrations) -> list[Measure]:
    """The reward's measures of each seed; refuses demonstrations that are too few for them."""
    _check(Path(demos.demo_set.where), demos.names)
    chosen = _recordings(demos)
    length = np.array([*map(len, chosen)], np.int32)

    def measured(programs, config, found):
        learner, hyper = learners.learner(config, demos), setup.pretrain_hyper(config)
        films = learner.films([entry.name for entry in chosen])

        def one(params):
            latents = learner.latents(params.encoder, films, hyper)
            return np.asarray(reward.latent_reward(params, jnp.asarray(latents)))

        return {"seeds": [measure(one(each.params), length, chosen) for each in found]}

    return [TAU, Measure("measures", measured)]


def _check(folder: Path, names: Mapping[str, Sequence[str]]) -> None:
    for split, what in (("failure", "failures"), ("validation", "successes kept aside")):
        count = len(names[split])
        if count < _LEAST:
            raise DemoError(
                f"{folder} has {count} {what}, but rho needs at least {_LEAST}: "
                f"make more with demos.num_{'failures' if split == 'failure' else 'validation'}"
            )


def _recordings(demos: Demonstrations) -> list[Demo]:
    """Held-out successes, then failures."""
    names = [*demos.names["validation"], *demos.names["failure"]]
    return [*demos.demo_set.select(names)]


def _of_true_stages(demos: Demonstrations) -> list[dict[str, Any]]:
    """A line for the reward of the true stages: an upper bound for any staircase."""
    chosen = _recordings(demos)
    if not all(entry.stages for entry in chosen):
        return []
    length = np.array([*map(len, chosen)], np.int32)
    left = [1 - stages_done(e, int(length.max())) / len(e.stages or "-") for e in chosen]
    values = measure(-np.stack(left).astype(np.float32), length, chosen)
    return [{"row": "true stages, -(1 - done / all)", "seed": 0} | values]


def kind_of(entry: Demo) -> str:
    """The kind of failure in a name such as "051_one_shoe"; "success" if it is none."""
    if entry.outcome != "failure":
        return "success"
    found = re.fullmatch(r"\d+_(.+)", entry.name)
    return found[1].replace("_", " ") if found else "failure"


def stages_done(entry: Demo, num_frames: int) -> Int[np.ndarray, "T"]:
    """The number of stages finished by each frame; 0 where they are unknown."""
    ends = [frame for frame in (entry.stages or {}).values() if frame >= 0]
    done = np.arange(num_frames) >= np.array(ends, int)[:, None]
    return done.sum(axis=0, dtype=np.int32)


def measure(
    reward: Float[np.ndarray, "B T"], length: Int[np.ndarray, "B"], entries: Sequence[Demo]
) -> dict[str, float]:
    """Computes `MEASURES`, and for each kind of failure `auc KIND` and `last KIND`.

    The length is that of each recording before padding. The order of stages is the mean over
    successes, NaN if their stages are not known. `last` is the mean reward of the last frames,
    `auc` compares the successes' with the kind's.
    """
    kinds = np.array([kind_of(entry) for entry in entries])
    success = kinds == "success"
    values = _compared(jnp.asarray(reward), jnp.asarray(length), jnp.asarray(success))
    found = {name: float(value) for name, value in values.items()}
    known = [i for i, e in enumerate(entries) if success[i] and e.stages]
    stages = np.stack([stages_done(entry, reward.shape[1]) for entry in entries])
    orders = np.asarray(_orders(jnp.asarray(reward), jnp.asarray(stages), jnp.asarray(length)))
    found["order"] = float(orders[known].mean()) if known else float("nan")
    last = reward[np.arange(len(reward)), length - 1]
    for kind in dict.fromkeys(kinds):
        found[f"last {kind}"] = float(last[kinds == kind].mean())
        if kind != "success":
            ones = jnp.asarray(np.r_[last[success], last[kinds == kind]])
            among = jnp.arange(len(ones)) < success.sum()
            found[f"auc {kind}"] = float(success_auc(ones, among))
    return found


@jax.jit
def _compared(reward, length, success: Bool[jax.Array, "B"]):
    last = jnp.take_along_axis(reward, length[:, None] - 1, axis=1)[:, 0]
    found = {"auc_final": success_auc(last, success)}
    for convention in CONVENTIONS:
        total = cumulative(reward, length, convention)
        found[f"rho_{convention}"] = ratio(total, success)
        # A sum of costs compares lengths if these differ, so there is none of natural lengths.
        if convention != "natural":
            found[f"auc_{convention}"] = success_auc(total, success)
    return found


_orders = jax.jit(jax.vmap(stage_order))


TABLE = Table(
    "table2",
    columns,
    text,
    figure=lambda found: spread(by_row(found.lines, "rho_held"), _SPREAD),
    measured={"tau": ("tau",), "measures": MEASURES},
    measures=_measures,
    reference=_of_true_stages,
)
