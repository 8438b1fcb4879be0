"""Table I as Markdown and CSV: one line a row of the table, and one line a policy.

A line is a mapping from columns to values; `row` and `seed` say which policy it is, the others are
numbers, and a column that is not known, or that a row does not have, is missing.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from gril_jax.report.sweep_table import median_reached

from .rows import PAPER
from .scores import LEVELS, SCORES, STARTS, spread

__all__ = ["COLUMNS", "Line", "columns", "markdown", "percent"]

Line = Mapping[str, Any]

REWARD = ("tau", "cycle", "order_demo", "hack_gap_demo")
_SOON = tuple(f"{unit}_{level}" for level in LEVELS for unit in ("steps", "seconds"))
COLUMNS = ("row", "seed", *SCORES, "env_steps", *_SOON, *REWARD)

_PERCENT = {
    f"success{suffix}{drawn}": f"{start.capitalize()} starts, {words}"
    for start, suffix in ((start, f"_{start}" * (start != STARTS[0])) for start in STARTS)
    for drawn, words in (("", "mean actions"), ("_sampled", "drawn actions"))
}
_REWARD_HEADS = {
    "tau": "tau", "cycle": "cycle consistency", "order_demo": "order", "hack_gap_demo": "hack gap",
}  # fmt: skip


def columns(lines: Sequence[Line]) -> dict[str, dict[str, str]]:
    """The table by its columns: heading to row to what stands there."""
    names = list(dict.fromkeys(line["row"] for line in lines))
    of = {name: [line for line in lines if line["row"] == name] for name in names}

    def column(name, write):
        return {row: write(_known(members, name)) for row, members in of.items()}

    table = {"paper": {row: f"{PAPER[row]:.1f}" if row in PAPER else "" for row in names}}
    table |= {f"success, {head}, %": column(name, percent) for name, head in _PERCENT.items()}
    for level in LEVELS:
        table[f"M env steps to {level} %"] = {
            row: _soon(members, f"steps_{level}", 1e-6, ".2f") for row, members in of.items()
        }
        table[f"seconds to {level} %"] = {
            row: _soon(members, f"seconds_{level}", 1.0, ".0f") for row, members in of.items()
        }
    return table | {head: column(name, _range) for name, head in _REWARD_HEADS.items()}


def percent(values: Float[np.ndarray, "n"]) -> str:
    """Mean, interquartile mean and its interval of some shares; nothing of none."""
    if not len(values):
        return ""
    found = spread(100 * values)
    return f"{found.mean:.1f}; {found.middle:.1f} ({found.low:.1f} to {found.high:.1f})"


def markdown(lines: Sequence[Line], about: Mapping[str, Any], *, evaluations: int) -> str:
    """Success and rewards, other starts, and how soon, as three tables with what they mean.

    Args:
      lines: of the policies that have finished.
      about: what was run, as in versions.json, with `demos_sha256`.
      evaluations: that lie in the last tenth of a policy's training.
    """
    table = columns(lines)
    heads = [*table]
    demo = [head for head in heads if "Demo starts" in head]
    elsewhere = [head for head in heads if "starts" in head and head not in demo]
    soon = [head for head in heads if " to " in head]
    seeds = {row: str(sum(line["row"] == row for line in lines)) for row in table["paper"]}
    first = {"seeds": seeds} | {h: table[h] for h in ("paper", *demo, *_REWARD_HEADS.values())}
    parts = [
        *_table(first), "",
        "Other starts than those of the task:", "",
        *_table({head: table[head] for head in elsewhere}), "",
        "How soon, from Demo starts with drawn actions:", "",
        *_table({head: table[head] for head in soon}), "",
        _legend(evaluations), "",
        _origin(about),
    ]  # fmt: skip
    return "\n".join(parts)


def _table(table: Mapping[str, Mapping[str, str]]) -> list[str]:
    rows = list(next(iter(table.values())))
    return [
        "| | " + " | ".join(table) + " |",
        "|---" * (len(table) + 1) + "|",
        *(
            f"| {row} | " + " | ".join(cells[row] for cells in table.values()) + " |"
            for row in rows
        ),
    ]


def _known(members: Sequence[Line], name: str) -> Float[np.ndarray, "n"]:
    values = np.array([line.get(name, np.nan) for line in members], np.float64)
    return values[np.isfinite(values)]


def _range(values: Float[np.ndarray, "n"]) -> str:
    if not len(values):
        return ""
    return f"{values.mean():.3f} ({values.min():.3f} to {values.max():.3f})"


def _soon(members: Sequence[Line], name: str, unit: float, form: str) -> str:
    values = np.array([line.get(name, np.nan) for line in members], np.float64)
    return median_reached(unit * values, form)


def _legend(evaluations: int) -> str:
    return (
        "Success is a final score of 1, all targets and nothing else in the region: mean over "
        "seeds; their interquartile mean and its 95 % bootstrap interval. Of each policy it is the "
        f"mean over the evaluations in the last tenth of its training ({evaluations}), each in "
        "fresh episodes, half with mean actions and half with drawn ones. From Demo starts nothing "
        "is drawn, so that with mean actions an evaluation gives 0 or 100 % for each seed. Paper: "
        "the success that its Table I reports. Steps and seconds are those at the first evaluation "
        "at or above so much success, without interpolation: the median over seeds, of which those "
        "that never got there come last, and how many got there. Seconds are those of a program "
        "with all its policies side by side, without the reward's training and without compiling, "
        "most of which is done while other programs run. Tau and cycle consistency are those on "
        "demonstrations kept aside; order is the "
        "share of pairs of made-up states that are paid in the order of their true progress, hack "
        "gap what the worst success is paid more than the best state without progress, both from "
        "Demo starts; mean (lowest to highest)."
    )


def _origin(about: Mapping[str, Any]) -> str:
    packages = about.get("packages", {})
    shown = ", ".join(
        f"{name} {packages[name]}" for name in ("gril-jax", "jax") if name in packages
    )
    return (
        f"`{about.get('command', '')}`, begun {about.get('started', '')} on "
        f"{about.get('device', '')}; {shown}; demonstrations with SHA-256 "
        f"{about.get('demos_sha256', '')}."
    )
