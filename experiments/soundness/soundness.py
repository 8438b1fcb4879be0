"""Choices of encoder training that make a reward sound, and how well an audit foretells success.

    gril soundness match_regions --seeds 5 --out RUN
    gril soundness --resume RUN
    gril soundness --join RUN,RUN --out FOLDER       tables of runs with different rows as one

For each row (`gril_jax.experiments.soundness.rows.ROWS`) and each seed an encoder is trained,
audited from Demo and from Layout starts, and a policy is trained with its reward. Writes
`soundness.csv` (a line an encoder), `soundness.md` (a line a row, and the correlation of each
figure with success) and `soundness.png`.
"""

from collections.abc import Mapping

import jax
from gril_jax.experiments.tables.audits import VARIANTS, audit, tasks
from gril_jax.experiments.tables.measures import TAU
from gril_jax.experiments.tables.programs import Program, programs
from gril_jax.experiments.tables.table import Found, Table

from gril_jax.report.figures.style import png

from .columns import AUDIT, COLUMNS, text
from .figure import figure
from .rows import Settings


def _plan(rows, num_classes: int, settings: Settings) -> list[Program]:
    tasks(rows[0].config.env)  # refuses what cannot be audited
    if not settings.policies:
        return []
    return programs(rows, num_classes, jax.devices(), at_once=settings.policies_at_once)


def _measures(config, settings: Settings, demos):
    return [TAU, audit(config.env, VARIANTS, starts=settings.starts, ascents=settings.ascents)]


def _pictures(found: Found, last: bool) -> Mapping[str, bytes]:
    trained = any("success" in line for line in found.lines)
    return {"soundness.png": png(figure(found.lines))} if trained else {}


TABLE = Table(
    "soundness",
    lambda lines: COLUMNS,
    text,
    _pictures,
    settings=Settings,
    plan=_plan,
    measured={"tau": ("tau",), "audit": AUDIT},
    measures=_measures,
    joins_csv=True,
)
