"""Table I and its figures as one HTML page."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from gril_jax.experiments.tables.table import Found
from gril_jax.experiments.tables.written import Section as TableSection
from gril_jax.experiments.tables.written import by_row, cells, with_paper

from gril_jax.report.figures.curves import spread, success_failure
from gril_jax.report.figures.style import png
from gril_jax.report.headline import Tile
from gril_jax.report.html import Cell, Part, Section, Table, render

from .columns import SECTIONS, text
from .rows import PAPER


def page(found: Found, figure: bytes) -> str:
    """The page, as one self-contained file."""
    success, rewards, *others = (_table(found, section) for section in SECTIONS)
    of = by_row(found.lines, "success_sampled")
    dots = Part(
        "A dot for each seed, and a bar at their mean; the dotted line is the first row's mean.",
        png(spread(of, "success, sampled actions, Demo starts")),
        "Success of each row's policies",
        wide=True,
    )
    curves = Part(
        "Figure 2: the interquartile mean over seeds within the band from their lower to their "
        "upper quartile.",
        figure,
        "Success against env steps and against seconds for each row",
        wide=True,
    )
    about = found.about
    versions = {str(k): str(x) for k, x in about.get("packages", {}).items()}
    return render(
        title="Table I: rewards for MatchRegions",
        summary=(
            "Policies trained alike on rewards of several kinds: success at the end of the episode "
            "with sampled actions, from Demo starts, mean over seeds and over the evaluations in "
            "the last tenth of training."
        ),
        tiles=[_tile(row, values) for row, values in of.items() if np.isfinite(values).all()],
        sections=[
            Section("Success", [dots, success, *others, curves]),
            Section("The learned rewards", [rewards, *_profiles(found.profiles)]),
        ],
        facts={k: str(x) for k, x in about.items() if not isinstance(x, Mapping)},
        tables={"Package versions": versions},
        listings={"Table I as Markdown": text(found)},
    )


def _tile(row: str, values: np.ndarray) -> Tile:
    paper = f"; the paper has {PAPER[row]:.1f}%" if row in PAPER else ""
    note = f"{100 * values.min():.1f}% to {100 * values.max():.1f}% over {len(values)} seeds"
    return Tile(f"{100 * values.mean():.1f}%", row, note + paper)


def _table(found: Found, section: TableSection) -> Table:
    """A section; in a cell the number, and below it what follows: `84.4; 84.4 (71.9 to 96.9)`."""
    rows = cells(with_paper(found.lines, PAPER, 1), section.columns)
    split = {
        row: [Cell(*re.split(r"; | (?=\()", cell, maxsplit=1)) for cell in texts]
        for row, texts in rows.items()
    }
    return Table(section.caption, [one.heading for one in section.columns], split)


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
