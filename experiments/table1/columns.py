"""The columns of Table I: the numbers of a policy, and the sections that people read."""

from gril_jax.experiments.tables.curves import Curve, first_at, in_last_tenth
from gril_jax.experiments.tables.table import Found
from gril_jax.experiments.tables.written import (
    SEEDS,
    Column,
    Section,
    markdown,
    mean_interval,
    median_reached,
    same,
    with_paper,
)

from .rows import PAPER

STARTS = ("demo", "jitter", "layout")
_LEVELS = (50, 80, 95)  # percent of success

# As `tables.training` calls them: deterministic actions, then sampled ones, from each start.
_SCORES = tuple(
    f"{name}{start}{actions}"
    for name in ("success", "score")
    for start in ("", *(f"_{start}" for start in STARTS[1:]))
    for actions in ("", "_sampled")
)
_SOON = tuple(f"{unit}_{level}" for level in _LEVELS for unit in ("steps", "seconds"))
REWARD = ("tau", "cycle", "order_demo", "hack_gap_demo")
COLUMNS = ("row", "seed", *_SCORES, "env_steps", *_SOON, *REWARD)

_percent = mean_interval(digits=1, unit=100.0)


def _reached(unit: str, factor: float, digits: int) -> list[Column]:
    write = median_reached(unit=factor, digits=digits)
    return [
        Column(f"{unit}_{level}", f"to {level} %", write, among="env_steps") for level in _LEVELS
    ]


SECTIONS = (
    Section(
        "Success from Demo starts, percent: mean over seeds; their interquartile mean and its 95 % "
        "bootstrap interval. Success is a final score of 1, all targets and nothing else in the "
        "region. Of each policy it is the mean over the evaluations in the last tenth of its "
        "training, each in fresh episodes, half with deterministic and half with sampled actions. "
        "Demo starts are all the same, so that with deterministic actions an evaluation gives 0 or "
        "100 % for each seed. Paper: the success that its Table I reports.",
        (
            SEEDS,
            Column("paper", "paper", same),
            Column("success", "deterministic actions", _percent),
            Column("success_sampled", "sampled actions", _percent),
        ),
    ),
    Section(
        "The learned rewards, mean over seeds (lowest to highest). Tau and cycle consistency are "
        "those on demonstrations kept aside. Order is the share of pairs of made-up states that "
        "are paid in the order of their true progress, hack gap what the worst success is paid "
        "more than the best state without progress, both from Demo starts.",
        (
            Column("tau", "tau"),
            Column("cycle", "cycle consistency"),
            Column("order_demo", "order"),
            Column("hack_gap_demo", "hack gap"),
        ),
    ),
    Section(
        "Success from other starts than those of the task, percent:",
        [
            Column(f"success_{start}{suffix}", f"{start.capitalize()} starts, {words}", _percent)
            for start in STARTS[1:]
            for suffix, words in (("", "deterministic"), ("_sampled", "sampled"))
        ],
    ),
    Section(
        "Million env steps until the first evaluation with so much success, from Demo starts with "
        "sampled actions, without interpolation: the median over seeds, of which those that never "
        "got there come last, and how many got there.",
        _reached("steps", 1e-6, 2),
    ),
    Section(
        "Seconds until the same evaluation. They are those of a program with all its policies side "
        "by side, without the reward's training and without compiling, most of which is done while "
        "other programs run.",
        _reached("seconds", 1.0, 0),
    ),
)


def policy(curve: Curve) -> dict[str, float]:
    """The scores of one policy as means over the last tenth, and how soon it got there.

    `steps_80` and `seconds_80` are those to 80 % success with sampled actions, from Demo starts.
    """
    last = in_last_tenth(curve.env_steps)
    found = {name: float(curve.scores[name][last].mean()) for name in _SCORES}
    found["env_steps"] = float(curve.env_steps[-1])
    success = curve.scores["success_sampled"]
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
    return f"{markdown(with_paper(found.lines, PAPER, 1), SECTIONS)}\n\n{origin}"
