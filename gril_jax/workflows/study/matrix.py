"""Tables whose rows are pairs, such as a reward at a level of help: matrices, and panels of curves.

A table's row is split into what names the matrix's row and what names its column.
"""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.figure import Figure

from gril_jax.report.figures.style import WIDTH, styled

from .counted import of_lines, one_start, solved
from .curves import Curve, draw_spread
from .results import Found
from .written import Line, column, median_reached

Split = Callable[[str], tuple[str, str]]  # a row's name -> names of the matrix's row and column

_REACHED = median_reached(unit=1e-6, digits=2)
_WRAP = 3  # panels side by side, at most, if there are more than can be read in one line
_FEW = 4


def matrices(found: Found, split: Split, columns: Sequence[str], heading: str) -> str:
    """Success with deterministic and sampled actions, and steps to 80 %, as Markdown.

    `columns` are those that there can be, in their order, and `heading` is written before each.
    """
    known = [line for line in found.lines if "success" in line]
    if not known:
        return ""
    counted = {
        sampled: of_lines(known, found.variant, sampled=sampled) for sampled in (False, True)
    }

    def matrix(write: Callable[[list[Line]], str]) -> str:
        return _matrix(known, split, columns, heading, write)

    single = one_start(known, found.variant)
    what = "Who solves" if single else "Success in the last evaluation, deterministic actions, of"
    how = "deterministic actions" if single else "percent, mean over policies (lowest to highest)"
    return "\n\n".join([
        f"{what} {counted[False]}: {how}.",
        matrix(_success("success", single=single)),
        f"Success with sampled actions, {counted[True]}: percent, mean over policies (lowest to "
        "highest).",
        matrix(_success("success_sampled")),
        "Million env steps of a policy until an evaluation with sampled actions has a success of "
        "at least 80 %: the median, and how many got there.",
        matrix(_soon),
    ])  # fmt: skip


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


def _matrix(lines, split: Split, columns, heading: str, write) -> str:
    of: dict[str, dict[str, list[Line]]] = {}
    for line in lines:
        row, where = split(line["row"])
        of.setdefault(row, {}).setdefault(where, []).append(line)
    shown = [one for one in columns if any(one in each for each in of.values())]
    rows = [
        f"| {row} | " + " | ".join(write(each[x]) if x in each else "" for x in shown) + " |"
        for row, each in of.items()
    ]
    head = "| reward | " + " | ".join(f"{heading}{one}" for one in shown) + " |"
    return "\n".join([head, "|---" * (len(shown) + 1) + "|", *rows])


@styled
def panels(found: Found, split: Split, columns: Sequence[str], heading: str) -> Figure:
    """Success against steps: a panel for each column, in it a line for each row."""
    of: dict[tuple[str, str], list[Curve]] = {}
    for curve in found.curves:
        of.setdefault(split(found.names[curve.cell]), []).append(curve)
    rows = [*dict.fromkeys(row for row, _ in of)]
    shown = [one for one in columns if any(one == other for _, other in of)]
    across = len(shown) if len(shown) <= _FEW else _WRAP
    down = -(-len(shown) // across)
    drawn = Figure(figsize=(WIDTH, (0.62 if down == 1 else 0.4 * down) * WIDTH))
    drawn.set_layout_engine("constrained")
    places = np.ravel(drawn.subplots(down, across, sharey=True, squeeze=False))
    for panel in places[len(shown) :]:
        panel.set_axis_off()
    for panel, where in zip(places, shown, strict=False):
        for number, row in enumerate(rows):
            curves = of.get((row, where))
            if curves is None:
                continue
            steps = np.mean([[0.0, *curve.env_steps] for curve in curves], axis=0) / 1e6
            success = np.stack([[0.0, *curve.scores["success_sampled"]] for curve in curves])
            draw_spread(panel, steps, success, number=number, label=row)
        panel.set(title=f"{heading}{where}", ylim=(-0.03, 1.03))
        panel.set_xlabel("million env steps")
    for panel in places[::across]:
        panel.set_ylabel("success, sampled actions")
    named = {
        label: line
        for panel in places
        for line, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    drawn.legend(named.values(), named, loc="outside lower center", ncols=3)
    return drawn
