"""The paper's Table II: how well learned rewards tell success from failure on a long task.

    gril table2 --seeds 5 --out RUN           five encoders a row; sized for a GPU
    gril table2 --quick --out RUN             two a row from fewer demonstrations, on a laptop
    gril table2 --resume RUN

For each row (`gril_jax.experiments.table2.rows.ROWS`) and seed an encoder is trained. Its reward is
measured along successes kept aside and along failures. Writes `table2.md`, `table2.csv` (a line an
encoder) and `table2.png`.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import learners, setup
from gril_jax.experiments.pipeline.demonstrations import Demonstrations
from gril_jax.experiments.tables.measures import TAU, Measure
from gril_jax.experiments.tables.table import Found, Table
from gril_jax.experiments.tables.written import by_row

from gril_jax import reward
from gril_jax.demos.schema import DemoEntry
from gril_jax.errors import DemoError
from gril_jax.report.figures.curves import spread
from gril_jax.report.figures.style import png

from .columns import columns, text
from .measures import MEASURES, measure, stages_done
from .rows import Settings

_LEAST = 2  # recordings of either outcome


def _measures(config, settings: Settings, demos: Demonstrations) -> list[Measure]:
    """The reward's measures of each seed; refuses demonstrations that are too few for them."""
    _check(demos.demo_set.folder, demos.names)
    chosen = _recordings(demos)
    length = np.array([entry.frames for entry in chosen], np.int32)

    def measured(program, config, found):
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


def _recordings(demos: Demonstrations) -> list[DemoEntry]:
    """Held-out successes, then failures."""
    entries = {entry.name: entry for entry in demos.demo_set.entries}
    return [entries[name] for split in ("validation", "failure") for name in demos.names[split]]


def _of_true_stages(demos: Demonstrations) -> list[dict[str, Any]]:
    """A line for the reward of the true stages: an upper bound for any staircase."""
    chosen = _recordings(demos)
    if not all(entry.stages for entry in chosen):
        return []
    length = np.array([entry.frames for entry in chosen], np.int32)
    left = [1 - stages_done(e, int(length.max())) / len(e.stages or "-") for e in chosen]
    values = measure(-np.stack(left).astype(np.float32), length, chosen)
    return [{"row": "true stages, -(1 - done / all)", "seed": 0} | values]


def _pictures(found: Found, last: bool) -> Mapping[str, bytes]:
    ratios = by_row(found.lines, "rho_held")
    label = "rho of held-out recordings, held to one length; lower is better"
    return {"table2.png": png(spread(ratios, label))}


TABLE = Table(
    "table2",
    columns,
    text,
    _pictures,
    settings=Settings,
    measured={"tau": ("tau",), "measures": MEASURES},
    measures=_measures,
    reference=_of_true_stages,
)
