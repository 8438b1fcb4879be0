"""A ladder of help: the same rewards and the same learner, given less and less beside the videos.

    gril ladder --demos DEMOS --rows "ours at level A,ours at level V"
    gril ladder --demos HUMAN --seeds 5

Rows are rewards, columns the levels of `experiments.pipeline.given`. For each of them and each seed
a policy is trained and evaluated from the task's own starts. Writes `ladder.md`, `ladder.csv` (a
line a policy) and `ladder.png`, the success of each reward against steps at each level.
"""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

from gril_jax.report.figures.style import WIDTH, styled

from ..tables.counted import of_lines, one_start, solved
from ..tables.curves import LAST, Curve, draw_spread
from ..tables.results import Found, Table
from ..tables.written import Line, column, median_reached
from .rows import LEVELS, ROWS, Settings, parts

_COLUMNS = ("row", "seed", *LAST, "steps_80", "tau")
_REACHED = median_reached(unit=1e-6, digits=2)


def _success(name: str, *, single: bool = False) -> Callable[[list[Line]], str]:
    def written(lines: list[Line]) -> str:
        if single:
            return solved(column(lines, name), len(lines))
        values = 100 * column(lines, name)
        return f"{values.mean():.1f} ({values.min():.1f} to {values.max():.1f})"

    return written


def _soon(lines: list[Line]) -> str:
    steps = column(lines, "steps_80")
    return _REACHED(steps[np.isfinite(steps)], len(steps))


def _text(found: Found) -> str:
    """Three matrices of rewards by levels, in Markdown."""
    known = [line for line in found.lines if "success" in line]
    if not known:
        return ""
    counted = {
        sampled: of_lines(known, found.variant, sampled=sampled) for sampled in (False, True)
    }
    single = one_start(known, found.variant)
    what = "Who solves" if single else "Success in the last evaluation, deterministic actions, of"
    how = "deterministic actions" if single else "percent, mean over policies (lowest to highest)"
    return "\n\n".join([
        f"{what} {counted[False]}: {how}.",
        _matrix(known, _success("success", single=single)),
        f"Success with sampled actions, {counted[True]}: percent, mean over policies (lowest to "
        "highest).",
        _matrix(known, _success("success_sampled")),
        "Million env steps of a policy until an evaluation with sampled actions has a success of "
        "at least 80 %: the median, and how many got there.",
        _matrix(known, _soon),
    ])  # fmt: skip


def _matrix(lines: list[Line], write: Callable[[list[Line]], str]) -> str:
    of: dict[str, dict[str, list[Line]]] = {}
    for line in lines:
        reward, level = parts(line["row"])
        of.setdefault(reward, {}).setdefault(level, []).append(line)
    levels = [level for level in LEVELS if any(level in each for each in of.values())]
    rows = [
        f"| {reward} | " + " | ".join(write(each[x]) if x in each else "" for x in levels) + " |"
        for reward, each in of.items()
    ]
    head = "| reward | " + " | ".join(f"level {level}" for level in levels) + " |"
    return "\n".join([head, "|---" * (len(levels) + 1) + "|", *rows])


def _figure(found: Found) -> Figure | None:
    return _panels(found.names, found.curves) if found.curves else None


@styled
def _panels(names: list[str], found: list[Curve]) -> Figure:
    """Success against steps: a panel for each level, in it a line for each reward."""
    of: dict[tuple[str, str], list[Curve]] = {}
    for curve in found:
        of.setdefault(parts(names[curve.cell]), []).append(curve)
    rewards = [*dict.fromkeys(reward for reward, _ in of)]
    levels = [level for level in LEVELS if any(level == other for _, other in of)]
    drawn = Figure(figsize=(WIDTH, 0.62 * WIDTH), layout="constrained")
    panels = np.ravel(drawn.subplots(1, len(levels), sharey=True, squeeze=False))
    for panel, level in zip(panels, levels, strict=True):
        for number, reward in enumerate(rewards):
            curves = of.get((reward, level))
            if curves is None:
                continue
            steps = np.mean([[0.0, *curve.env_steps] for curve in curves], axis=0) / 1e6
            success = np.stack([[0.0, *curve.scores["success_sampled"]] for curve in curves])
            draw_spread(panel, steps, success, number=number, label=reward)
        panel.set(title=f"level {level}", ylim=(-0.03, 1.03))
        panel.set_xlabel("million env steps")
    panels[0].set_ylabel("success, sampled actions")
    shown = {
        label: line
        for panel in panels
        for line, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    drawn.legend(shown.values(), shown, loc="outside lower center", ncols=3)
    return drawn


TABLE = Table(
    "ladder",
    columns=lambda lines: _COLUMNS,
    text=_text,
    figure=_figure,
    settings=Settings,
    plan=lambda rows, settings, programs: programs(rows),
    order=[*ROWS],
)
