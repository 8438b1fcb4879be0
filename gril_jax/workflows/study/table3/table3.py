"""Table III: the long tasks at the table, one learner, one budget, and rewards of all kinds.

    gril table3 --sets DEMOS --seeds 5 --env.engine warp       sized for a GPU
    gril table3 --rows "ours on umbrella_out,the task's own on umbrella_out"

Rows are rewards, columns tasks. For each of them and each seed a policy is trained and evaluated
from the task's own starts; `DEMOS` has a set of demonstrations for each task, in a folder of its
name, and without it they are made. Writes `table3.md`, `table3.csv` (a line a policy) and
`table3.png`, the success of each reward against steps on each task.
"""

from matplotlib.figure import Figure

from gril_jax.workflows.study.curves import LAST
from gril_jax.workflows.study.matrix import matrices, panels
from gril_jax.workflows.study.results import Found, Table

from .rows import ROWS, TASKS, Settings, configs, parts


def _figure(found: Found) -> Figure | None:
    return panels(found, parts, TASKS, "") if found.curves else None


TABLE = Table(
    "table3",
    columns=lambda lines: ("row", "seed", *LAST, "steps_80", "tau"),
    text=lambda found: matrices(found, parts, TASKS, ""),
    figure=_figure,
    settings=Settings,
    configs=configs,
    plan=lambda rows, settings, programs: programs(rows),
    order=[*ROWS],
    one_set=False,
)
