"""A ladder of help: the same rewards and the same learner, given less and less beside the videos.

    gril ladder --demos DEMOS --rows "ours at level A,ours at level V"
    gril ladder --demos HUMAN --seeds 5
    gril ladder shoes_in_box --rows "ours with sub-policies at level B" --env.engine warp

Rows are rewards, columns the levels of `experiments.pipeline.given`. For each of them and each seed
a policy is trained and evaluated from the task's own starts. Writes `ladder.md`, `ladder.csv` (a
line a policy) and `ladder.png`, the success of each reward against steps at each level.
"""

from matplotlib.figure import Figure

from gril_jax.workflows.study.curves import LAST
from gril_jax.workflows.study.matrix import matrices, panels
from gril_jax.workflows.study.results import Found, Table

from .rows import LEVELS, ROWS, TABLE_ROWS, Settings, parts

_COLUMNS = ("row", "seed", *LAST, "steps_80", "tau")
_HEADING = "level "


def _figure(found: Found) -> Figure | None:
    return panels(found, parts, LEVELS, _HEADING) if found.curves else None


TABLE = Table(
    "ladder",
    columns=lambda lines: _COLUMNS,
    text=lambda found: matrices(found, parts, LEVELS, _HEADING),
    figure=_figure,
    settings=Settings,
    plan=lambda rows, settings, programs: programs(rows),
    order=[*(ROWS | TABLE_ROWS)],
)
