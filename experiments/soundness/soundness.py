"""Choices of encoder training that make a reward sound, and how well an audit foretells success.

    gril soundness match_regions --seeds 5 --out RUN
    gril soundness --join RUN,RUN --out FOLDER       tables of runs with different rows as one

For each row and seed an encoder is trained, audited from Demo and from Layout starts, and a policy
is trained with its reward. Writes `soundness.csv` (a line an encoder), `soundness.md` (a line a
row, and the correlation of each figure with success) and `soundness.png`.
"""

from ..tables.audits import VARIANTS, audit, tasks
from ..tables.measures import TAU
from ..tables.results import Found, Table
from .columns import AUDIT, COLUMNS, figure, text
from .rows import Settings


def _plan(rows, settings: Settings, programs):
    tasks(rows[0].config.env)  # refuses what cannot be audited
    return programs(rows, at_once=settings.policies_at_once) if settings.policies else []


def _measures(config, settings: Settings, demos):
    return [TAU, audit(config.env, VARIANTS, starts=settings.starts, ascents=settings.ascents)]


def _figure(found: Found):
    return figure(found.lines) if any("success" in line for line in found.lines) else None


TABLE = Table(
    "soundness",
    columns=lambda lines: COLUMNS,
    text=text,
    figure=_figure,
    settings=Settings,
    plan=_plan,
    measured={"tau": ("tau",), "audit": AUDIT},
    measures=_measures,
    joins_csv=True,
)
