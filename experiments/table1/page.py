"""Table I and its figures as one HTML page."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gril_jax.report.figures.curves import success_failure
from gril_jax.report.figures.spread import spread
from gril_jax.report.figures.style import png
from gril_jax.report.headline import Tile
from gril_jax.report.html import Cell, Part, Section, Table, render

from .rows import PAPER
from .table import Line, columns

__all__ = ["page"]


def page(
    lines: Sequence[Line],
    table: str,
    figure: bytes,
    profiles: Mapping[str, Mapping[str, Any]],
    about: Mapping[str, Any],
) -> str:
    """The page, which needs no other file.

    Args:
      lines: of the policies that have finished; at least one.
      table: as Markdown.
      figure: Figure 2 as PNG.
      profiles: of each row's learned reward, from `table1_profiles.measure`.
      about: what was run, as in versions.json.
    """
    facts = {k: str(x) for k, x in about.items() if not isinstance(x, Mapping)}
    versions = {str(k): str(x) for k, x in about.get("packages", {}).items()}
    success, elsewhere, soon, rewards = _tables(lines)
    return render(
        title="Table I: rewards for MatchRegions",
        summary=(
            "Policies trained alike on rewards of several kinds: success at the end of the episode "
            "with actions drawn, from Demo starts, mean over seeds and over the evaluations in the "
            "last tenth of training. The table as Markdown, at the end, says more of each column."
        ),
        tiles=_tiles(lines),
        sections=[
            Section("Success", [_success(lines), success, elsewhere, soon, _figure2(figure)]),
            Section("The learned rewards", [rewards, *_profiles(profiles)]),
        ],
        facts=facts,
        tables={"Package versions": versions},
        listings={"Table I as Markdown": table},
    )


def _of(lines: Sequence[Line], name: str) -> dict[str, np.ndarray]:
    rows = dict.fromkeys(line["row"] for line in lines)
    return {row: np.array([m[name] for m in lines if m["row"] == row], float) for row in rows}


def _tiles(lines: Sequence[Line]) -> list[Tile]:
    tiles = []
    for row, values in _of(lines, "success_sampled").items():
        paper = f"; the paper has {PAPER[row]:.1f}%" if row in PAPER else ""
        note = f"{100 * values.min():.1f}% to {100 * values.max():.1f}% over {len(values)} seeds"
        tiles.append(Tile(f"{100 * values.mean():.1f}%", row, note + paper))
    return tiles


def _tables(lines: Sequence[Line]) -> tuple[Table, Table, Table, Table]:
    """The columns of Table I: success, other starts, how soon, and the rewards."""
    of = columns(lines)
    seeds = {row: str(sum(line["row"] == row for line in lines)) for row in of["paper"]}
    starts = [head for head in of if " starts, " in head]
    demo = [head for head in starts if "Demo starts" in head]
    soon = [head for head in of if " to " in head]
    rewards = [head for head in of if head not in ("paper", *starts, *soon)]

    def table(caption: str, chosen: Mapping[str, Mapping[str, str]]) -> Table:
        rows = {row: [_cell(column[row]) for column in chosen.values()] for row in seeds}
        return Table(caption, [*chosen], rows)

    return (
        table(
            "Mean over seeds; below it their interquartile mean and its 95% bootstrap interval. "
            "Paper: the success that its Table I reports.",
            {"seeds": seeds} | {head: of[head] for head in ("paper", *demo)},
        ),
        table(
            "The same from other starts than those of the task.",
            {head: of[head] for head in starts if head not in demo},
        ),
        table(
            "Until the first evaluation with so much success, from Demo starts with drawn actions: "
            "median over seeds, and how many of them ever got there.",
            {head: of[head] for head in soon},
        ),
        table(
            "Of the rewards that are learned, mean over seeds and lowest to highest. Tau and cycle "
            "consistency are those on demonstrations kept aside. Order is the share of pairs of "
            "made-up states that are paid in the order of their true progress, hack gap what the "
            "worst success is paid more than the best state without progress.",
            {head: of[head] for head in rewards},
        ),
    )


def _cell(text: str) -> Cell:
    """The number, and below it what follows: `0.91 (0.90 to 0.92)`, `84.4; 84.4 (71.9 to 96.9)`."""
    value, *rest = re.split(r"; | (?=\()", text, maxsplit=1)
    return Cell(value, *rest)


def _success(lines: Sequence[Line]) -> Part:
    figure = spread(_of(lines, "success_sampled"), "success, actions drawn, Demo starts")
    return Part(
        "A dot for each seed, and a bar at their mean; the dotted line is the first row's mean.",
        png(figure),
        "Success of each row's policies",
        wide=True,
    )


def _figure2(figure: bytes) -> Part:
    return Part(
        "Figure 2: the interquartile mean over seeds within the band from their lower to their "
        "upper quartile. Seconds are those of a program with all its policies, without compiling.",
        figure,
        "Success against env steps and against seconds for each row",
        wide=True,
    )


def _profiles(profiles: Mapping[str, Mapping[str, Any]]) -> list[Part]:
    parts = []
    for row, found in profiles.items():
        success, failure = (
            [np.array(x, float) for x in found[k] if len(x)] for k in ("success", "failure")
        )
        if not success or not failure:
            parts.append(Part(f"{row}: there are no failed demonstrations to compare with."))
            continue
        parts.append(
            Part(
                f"{row}: the reward along demonstrations kept aside, successful (left) and failed "
                "(right), of the first seed. Successes should end near the top, failures below.",
                png(success_failure(success, failure)),
                f"Rewards along demonstrations: {row}",
            )
        )
    return parts or [Part("No reward was learned from graphs.")]
