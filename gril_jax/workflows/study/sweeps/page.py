"""The page of a sweep: its cells, how far their seeds differ, and whether rewards are sound."""

import numpy as np

from gril_jax.report import html
from gril_jax.report.headline import Tile
from gril_jax.report.html import Part
from gril_jax.workflows.study.counted import of_lines, one_start, success_columns
from gril_jax.workflows.study.page import dots, facts, page_table, versions
from gril_jax.workflows.study.results import Found
from gril_jax.workflows.study.written import (
    SEEDS,
    Column,
    Section,
    by_row,
    markdown,
    mean_interval,
    median_reached,
)

SOUND = "sound"  # 1 in the line of a reward that keeps the bounds of its audit, 0 in others
_REACHED = median_reached(unit=1e-6, digits=2)
_MOST = 4  # tiles: the best cells


def _share(values: np.ndarray, count: int) -> str:
    return f"{int(values.sum())} of {count}"


def sections(found: Found) -> list[Section]:
    """The sections of the table, whose headings say what an evaluation counts."""
    among = of_lines(found.lines, found.variant)
    return [
        Section(
            "Mean; interquartile mean with its 95 % bootstrap interval over policies, each of "
            "which is one observation: its success in its last evaluation, from fresh starts. "
            "Steps are those at the first evaluation with a success of at least 80 % (sampled "
            "actions), the median over policies, of which those that never got there come last, "
            "and how many got there.",
            (
                SEEDS._replace(heading="policies"),
                *success_columns(found.lines, found.variant),
                Column("steps_80", "M env steps to 80 %", _REACHED, among="env_steps"),
            ),
        ),
        Section(
            "The same of other scores, with deterministic actions; the mean of the learned "
            "rewards' tau, and how many of them are sound by their audit:",
            (
                Column("success_ever", f"success at some moment, {among}", mean_interval()),
                Column("score", "score", mean_interval()),
                Column("tau", "tau", lambda values, count: f"{values.mean():.3f}"),
                Column(SOUND, "sound rewards", _share),
            ),
        ),
    ]


def page(found: Found, figure: bytes) -> str:
    """The page, as one self-contained file."""
    sampled = one_start(found.lines, found.variant)  # with mean actions a policy solves it or not
    score, actions = ("success_sampled", "sampled") if sampled else ("success", "deterministic")
    of = by_row(found.lines, score)
    counted = of_lines(found.lines, found.variant, sampled=sampled)
    picture = dots(of, f"success, {actions} actions", counted, "cell")
    curves = Part(
        "Success with sampled actions while policies are trained, the interquartile mean over "
        "policies within the band from their lower to their upper quartile.",
        figure,
        "Success against env steps for each cell",
        wide=True,
    )
    tables = [page_table(found.lines, section) for section in sections(found)]
    return html.render(
        title="Sweep",
        summary=f"Success of policies at the end of the episode, {actions} actions, {counted}. "
        f"Each policy is one observation. {found.about.get('given', '')}",
        tiles=_tiles(found, of, counted),
        sections=[
            html.Section("Success", [picture, *tables]),
            html.Section("Learning", [curves]),
            html.Section(
                "What next",
                steps=[
                    html.Step("Train one cell by itself.", "gril train RUN/cells/000.yaml"),
                    html.Step("Go on where a sweep was cut off.", "gril sweep --resume RUN"),
                ],
            ),
        ],
        facts=facts(found),
        tables={"Package versions": versions(found)},
        listings={"The table as Markdown": markdown(found.lines, sections(found))},
    )


def _tiles(found: Found, of: dict[str, np.ndarray], counted: str) -> list[Tile]:
    """The best cells, each with the spread of its policies, and the audits of all rewards."""
    known = {name: x[np.isfinite(x)] for name, x in of.items() if np.isfinite(x).any()}
    best = sorted(known, key=lambda name: -known[name].mean())[:_MOST]
    tiles = [
        Tile(
            f"{known[name].mean():.1%}",
            name,
            f"{known[name].min():.1%} to {known[name].max():.1%} over {len(known[name])} policies, "
            f"{counted}",
        )
        for name in best
    ]
    audited = [line[SOUND] for line in found.lines if SOUND in line]
    if not audited:
        note = "--run.audit 300 searches for states that the rewards overestimate"
        return [*tiles, Tile("not audited", "the rewards, by their audit", note)]
    value = f"{sum(audited):.0f} of {len(audited)} sound"
    return [*tiles, Tile(value, "the rewards, by their audit")]
