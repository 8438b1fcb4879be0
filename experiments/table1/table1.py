"""The paper's Table I and Figure 2: one task, one learner, one budget, and thirteen rewards.

    gril table1                               five seeds; sized for a GPU
    gril table1 --demos HUMAN --seeds 10
    gril table1 --quick                       two rows and two seeds of one block, on a laptop
    gril table1 --resume RUN
    gril table1 --join RUN,RUN --out FOLDER      runs with different rows as one table

For each row (`gril_jax.experiments.table1.rows.ROWS`) and seed an encoder is trained where the row
learns a reward, audited, and a policy is trained with that reward. Writes `table1.md` and
`table1.csv` (a line a policy) after each program, `figure2.png` and `report.html` at the end.
`gril report RUN` draws what there is of a run that was cut off.
"""

from collections.abc import Mapping
from typing import Any

import jax
from gril_jax.experiments.tables.audits import audit
from gril_jax.experiments.tables.figure import learning_curves
from gril_jax.experiments.tables.programs import programs
from gril_jax.experiments.tables.table import Found, Table
from gril_jax.experiments.tables.written import by_row

from gril_jax.report.figures.style import png

from .columns import COLUMNS, REWARD, STARTS, policy, text
from .page import page
from .profiles import profiles
from .rows import ROWS, Settings


def _pictures(found: Found, last: bool) -> Mapping[str, bytes]:
    """Figure and page at the end alone: they take seconds."""
    if not last or not found.curves:
        return {}
    figure = png(learning_curves(found.names, found.curves))
    return {"figure2.png": figure, "report.html": page(found, figure).encode()}


def _measures(config, settings: Settings, demos):
    """Audits from the first kind of start, and rewards along demonstrations."""
    work = {"starts": settings.starts, "ascents": settings.ascents}
    return [audit(config.env, STARTS[:1], **work), profiles(demos)]


def _summary(found: Found) -> dict[str, Any]:
    rows: dict[str, dict[str, float]] = {}
    for name in ("success", "success_sampled"):
        for row, values in by_row(found.lines, name).items():
            rows.setdefault(row, {})[name] = sum(values.tolist()) / len(values)
    return {"rows": rows} | dict(found.about)


TABLE = Table(
    "table1",
    lambda lines: COLUMNS,
    text,
    _pictures,
    settings=Settings,
    plan=lambda rows, num_classes, settings: programs(
        rows, num_classes, jax.devices(), starts=STARTS
    ),
    policy=policy,
    measured={"audit": REWARD[2:], "profiles": REWARD[1:2]},
    measures=_measures,
    order=[*ROWS],
    summary=_summary,
)
