"""The page of Table I: the numbers of a policy, the sections of the table, and the HTML."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gril_jax.envs import registry
from gril_jax.report import html
from gril_jax.report.figures.curves import success_failure
from gril_jax.report.figures.style import png
from gril_jax.report.headline import Tile
from gril_jax.report.html import Part
from gril_jax.workflows.study.counted import Counted, in_words, solved
from gril_jax.workflows.study.curves import Curve, first_at, in_last_tenth
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
    with_paper,
)

from .rows import PAPER

# What the task says: its own single start, the many that success is counted over, and elsewhere.
STARTS = registry.starts("match_regions", "demo")
_HEADLINE = f"success_{STARTS.many}"
_LEVELS = (50, 80, 95)  # percent of success

# As `tables.programs` calls them: deterministic actions, then sampled ones, from each start.
_SCORES = tuple(
    f"{name}{start}{actions}"
    for name in ("success", "score")
    for start in ("", *(f"_{start}" for start in STARTS[1:]))
    for actions in ("", "_sampled")
)
SUCCESS = _SCORES[:6]
_SOON = tuple(f"{unit}_{level}" for level in _LEVELS for unit in ("steps", "seconds"))
REWARD = ("tau", "cycle", "order_demo", "hack_gap_demo")
COLUMNS = ("row", "seed", *_SCORES, "env_steps", *_SOON, *REWARD)

_percent = mean_interval(digits=1, unit=100.0)


def _reached(unit: str, factor: float, digits: int) -> list[Column]:
    write = median_reached(unit=factor, digits=digits)
    return [
        Column(f"{unit}_{level}", f"to {level} %", write, among="env_steps") for level in _LEVELS
    ]


def sections(starts: Mapping[str, Counted]) -> list[Section]:
    """The sections of the table, whose headings say what an evaluation counts."""

    def headed(variant: str, words: str, write: Any = _percent) -> Column:
        suffix = "_sampled" if (sampled := words.startswith("sampled")) else ""
        name = f"success{'' if variant == STARTS.own else f'_{variant}'}{suffix}"
        return Column(name, f"{words}, {in_words(starts, variant, sampled=sampled)}", write)

    def both(variant: str, write: Any = _percent) -> list[Column]:
        return [headed(variant, "deterministic actions", write), headed(variant, "sampled actions")]

    many, own, elsewhere = (name.capitalize() for name in (STARTS.many, STARTS.own, STARTS[2]))
    return [
        Section(
            f"Success from {many} starts, percent: mean over policies; their interquartile mean "
            "and its 95 % bootstrap interval. Each policy is one observation: the mean over the "
            "evaluations in the last tenth of its training, each from fresh starts. Success is a "
            "final score of 1, all targets and nothing else in the region. Paper: the success that "
            "its Table I reports.",
            (
                SEEDS._replace(heading="policies"), Column("paper", "paper"), *both(STARTS.many),
            ),
        ),
        _REWARDS,
        Section(
            f"From the task's own start, {own}, a single one, which a policy solves with "
            "deterministic actions in all of these evaluations or not; sampled actions, percent:",
            both(STARTS.own, solved),
        ),
        Section(f"Success from {elsewhere} starts, percent:", both(STARTS.elsewhere)),
        Section(
            "Million env steps until the first evaluation with so much success, from "
            f"{many} starts with sampled actions, without interpolation: the median over policies, "
            "of which those that never got there come last, and how many got there.",
            _reached("steps", 1e-6, 2),
        ),
        Section(
            "Seconds until the same evaluation. They are those of a program with all its policies "
            "side by side, without the reward's training and without compiling, most of which is "
            "done while other programs run.",
            _reached("seconds", 1.0, 0),
        ),
    ]  # fmt: skip


_REWARDS = Section(
    "The learned rewards, mean over seeds (lowest to highest). Tau and cycle consistency are those "
    "on demonstrations kept aside. Order is the share of pairs of made-up states that are paid in "
    "the order of their true progress, hack gap what the worst success is paid more than the best "
    f"state without progress, both from {STARTS.own.capitalize()} starts.",
    (
        Column("tau", "tau"),
        Column("cycle", "cycle consistency"),
        Column("order_demo", "order"),
        Column("hack_gap_demo", "hack gap"),
    ),
)


def policy(curve: Curve) -> dict[str, float]:
    """The scores of one policy as means over the last tenth, and how soon it got there."""
    last = in_last_tenth(curve.env_steps)
    found = {name: float(curve.scores[name][last].mean()) for name in _SCORES}
    found["env_steps"] = float(curve.env_steps[-1])
    success = curve.scores[f"{_HEADLINE}_sampled"]
    for level in _LEVELS:
        found[f"steps_{level}"] = first_at(success, curve.env_steps, level=level / 100)
        found[f"seconds_{level}"] = first_at(success, curve.seconds, level=level / 100)
    return found


def text(found: Found) -> str:
    """The table as Markdown, and what made it."""
    about, packages = found.about, found.about.get("packages", {})
    shown = ", ".join(
        f"{name} {packages[name]}" for name in ("gril-jax", "jax") if name in packages
    )
    origin = (
        f"`{about.get('command', '')}`, begun {about.get('started', '')} on "
        f"{about.get('device', '')}; {shown}; demonstrations with SHA-256 "
        f"{about.get('demos_sha256', '')}."
    )
    return f"{markdown(with_paper(found.lines, PAPER, 1), sections(found.starts))}\n\n{origin}"


def page(found: Found, figure: bytes) -> str:
    """The page, as one self-contained file."""
    success, rewards, *others = (
        page_table(with_paper(found.lines, PAPER, 1), section) for section in sections(found.starts)
    )
    of = by_row(found.lines, f"{_HEADLINE}_sampled")
    counted = in_words(found.starts, STARTS.many, sampled=True)
    label = f"success, sampled actions, {STARTS.many.capitalize()} starts"
    picture = dots(of, label, counted, "row")
    curves = Part(
        f"Figure 2: success with sampled actions ({counted}), the interquartile mean over policies "
        "within the band from their lower to their upper quartile.",
        figure,
        "Success against env steps and against seconds for each row",
        wide=True,
    )
    return html.render(
        title="Table I: rewards for MatchRegions",
        summary=(
            "Policies trained alike on rewards of several kinds: success at the end of the episode "
            f"with sampled actions ({counted}), mean over policies and over the evaluations in the "
            "last tenth of training."
        ),
        tiles=[
            _tile(row, values, counted) for row, values in of.items() if np.isfinite(values).all()
        ],
        sections=[
            html.Section("Success", [picture, success, *others, curves]),
            html.Section("The learned rewards", [rewards, *_profiles(found.profiles)]),
        ],
        facts=facts(found),
        tables={"Package versions": versions(found)},
        listings={"Table I as Markdown": text(found)},
    )


def _tile(row: str, values: np.ndarray, counted: str) -> Tile:
    mean, middle = _percent(values, len(values)).split("; ")
    paper = f"; the paper has {PAPER[row]:.1f}%" if row in PAPER else ""
    note = f"interquartile mean {middle} over {len(values)} policies, {counted}{paper}"
    return Tile(f"{mean}%", row, note)


def _profiles(profiles: Mapping[str, Mapping[str, Any]]) -> list[Part]:
    parts = []
    for row, found in profiles.items():
        success, failure = (
            [np.array(x, float) for x in found[k] if len(x)] for k in ("success", "failure")
        )
        if not success or not failure:
            parts.append(Part(f"{row}: there are no failed demonstrations to compare with."))
            continue
        caption = (
            f"{row}: the reward along demonstrations kept aside, successful (left) and failed "
            "(right), of the first seed. Successes should end near the top, failures below."
        )
        figure = png(success_failure(success, failure))
        parts.append(Part(caption, figure, f"Rewards along demonstrations: {row}"))
    return parts or [Part("No reward was learned from graphs.")]
