"""The table of a study: sections of columns, as far as the lines have something of them.

Shapes use K for the known values of a row's lines.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gril_jax.metrics.order import interquartile_interval, interquartile_mean
from gril_jax.report.rates import SURE, UNKNOWN

from .results import LEVELS, PASSES, Found, Line

_MOST = 4  # columns beside the rows' names

Values = Float[np.ndarray, "K"]


# --- cells: a row's known values, and how many lines it has


def mean_range(values: Values, count: int) -> str:
    """`0.50 (0.40 to 0.60)`: the mean, the lowest and the highest of what is defined."""
    lacking = f"; {count - len(values)} undefined" if len(values) < count else ""
    return f"{values.mean():.3f} ({values.min():.3f} to {values.max():.3f}{lacking})"


def percent(values: Values, count: int) -> str:
    """`84.4; 85.0 (71.9 to 96.9)`: mean, interquartile mean and its 95 % bootstrap interval."""
    return "{}; {} {}".format(*_spread(100 * values, digits=1))


def score(values: Values, count: int) -> str:
    """`0.844; 0.850 (0.719 to 0.969)`: the same of any number."""
    return "{}; {} {}".format(*_spread(values, digits=3))


def share(values: Values, count: int) -> str:
    """`0.844 (0.719 to 0.969)`: the mean, and that interval; of one value the value."""
    mean, _, interval = _spread(values, digits=3)
    return mean if len(values) == 1 else f"{mean} {interval}"


def _spread(values: Values, *, digits: int) -> tuple[str, str, str]:
    found = _interquartile(jnp.asarray(values, jnp.float32))
    between, low, high = (f"{float(x):.{digits}f}" for x in found)
    return f"{values.mean():.{digits}f}", between, f"({low} to {high})"


@jax.jit
def _interquartile(values):
    low, high = interquartile_interval(jax.random.key(0), values)
    return interquartile_mean(values), low, high


def median_reached(values: Values, count: int) -> str:
    """`4.80 (4 of 5)`: the median of million steps, and how many of the seeds got there.

    Seeds that never got there come last; of an even number the later of the middle two counts.
    """
    late = count // 2
    shown = f"{1e-6 * np.sort(values)[late]:.2f}" if late < len(values) else "never"
    return f"{shown} ({len(values)} of {count})"


def solved(values: Values, count: int) -> str:
    """The number of policies that succeed from a single start: `4 of 5 policies succeed`."""
    return f"{int((values >= SURE).sum())} of {len(values)} policies succeed"


class Column(NamedTuple):
    """One column of a section."""

    name: str  # in the lines
    heading: str
    write: Callable[[Any, int], str] = mean_range
    among: str = ""  # written for the lines that have a number of this name, known or not


class Section(NamedTuple):
    """Columns that stand together below a caption."""

    caption: str
    columns: Sequence[Column]


class Part(NamedTuple):
    """A section with what is known: neither rows nor columns without anything."""

    caption: str
    headings: list[str]
    cells: dict[str, list[str]]  # by row


def _count(heading: str, among: str) -> Column:
    return Column("seed", heading, lambda values, count: str(count), among)


# --- sections


def sections(found: Found) -> list[Section]:
    """All that a study may have."""
    named = dict.fromkeys(name for line in found.lines for name in line)
    return [*_of_policies(found), *_of_rewards([*named]), *_of_variants(found.lines, [*named])]


def _of_policies(found: Found) -> list[Section]:
    (first, suffix), *others = found.starts.items()
    counted = found.counted(first)
    success = [
        _count("policies", among="env_steps"),
        *_success(found, first, suffix),
        Column(f"success_ever{suffix}", f"success at some time, {counted}", percent),
        Column(f"score{suffix}", "score, deterministic actions", score),
    ]
    speed = [
        Column(f"steps_{x}", f"to {x} % of {counted}", median_reached, "env_steps") for x in LEVELS
    ]
    return [
        Section(
            "Success in percent: mean; interquartile mean and its 95 % bootstrap interval over "
            "policies, each of which is one observation: the mean over the evaluations in the last "
            "tenth of its training, each from fresh starts.",
            success,
        ),
        Section(
            "Million env steps to the first evaluation with so much success (sampled actions): the "
            "median over policies, of which those that never got there come last, and how many "
            "got there.",
            speed,
        ),
        *(
            Section(f"Success from {x.capitalize()} starts, percent:", _success(found, x, behind))
            for x, behind in others
        ),
    ]


def _success(found: Found, variant: str, suffix: str) -> list[Column]:
    """Success with deterministic and with sampled actions; of one start, how many succeed."""
    counted, played = (found.counted(variant, sampled=x) for x in (False, True))
    single = counted.startswith("one ")
    words, write = ("", solved) if single else ("success, ", percent)
    return [
        Column(f"success{suffix}", f"{words}deterministic actions, {counted}", write),
        Column(f"success{suffix}_sampled", f"success, sampled actions, {played}", percent),
    ]


def _of_rewards(names: Sequence[str]) -> list[Section]:
    return [
        Section(
            "The learned rewards, mean over seeds (lowest to highest), on demonstrations kept "
            "aside: alignment tau, cycle consistency, tau of reward and time, the last reward; and "
            "how many keep the bounds of their audit.",
            [
                _count("rewards", among="tau"),
                Column("tau", "alignment tau"),
                Column("cycle", "cycle consistency"),
                Column("reward_time_tau", "reward against time"),
                Column("reward_last", "last reward"),
                Column(PASSES, "pass their audit", lambda x, n: f"{int(x.sum())} of {n}", PASSES),
            ],
        ),
        Section(
            "Correlation of reward and time along videos kept aside, mean over seeds (lowest to "
            "highest). VOC is Pearson's or Spearman's. With resting ends the last reward is held "
            "for the frames that were cut from the end of a video.",
            [
                Column("voc_pearson", "VOC, Pearson"),
                Column("voc_spearman", "VOC, Spearman"),
                Column("voc_pearson_tails", "Pearson, with resting ends"),
                Column("voc_spearman_tails", "Spearman, with resting ends"),
                Column("reward_time_tau_tails", "tau, with resting ends"),
            ],
        ),
        *(_of_audit(x.removeprefix("order_")) for x in names if x.startswith("order_")),
        *_elsewhere([x.removeprefix("ranks_") for x in names if x.startswith("ranks_")]),
        Section(
            "Mean over seeds (95 % bootstrap interval of the interquartile mean). rho (Eq. 8) is "
            "the mean |cumulative reward| of held-out successes over that of failures, lower is "
            "better. A sum depends on how long a recording is, and failures are often short. held: "
            "what a recording ends with goes on to the length of the longest; resampled: each is "
            "stretched to that length; natural: as it is. The paper does not say which is its own.",
            [Column(f"rho_{x}", f"rho, {x}", share) for x in ("held", "resampled", "natural")],
        ),
        Section(
            "AUC: how often a success is above a failure, by the reward of its last frame or by "
            "its held sum. Preferences: pairs of videos in which the better one ends with the "
            "higher reward. Ranking: tau-a of last rewards with the order of the videos. Order of "
            "stages: Somers' D of the reward with the number of stages done, held-out successes.",
            [
                Column("auc_final", "AUC, last reward", share),
                Column("auc_held", "AUC, held sum", share),
                Column("preference_accuracy", "preferences in order", share),
                Column("policy_ranking", "policy ranking", share),
                Column("order", "order of stages", share),
            ],
        ),
        Section(
            "AUC of the last reward, successes against failures of each kind:",
            [Column(x, x.removeprefix("auc "), share) for x in names if x.startswith("auc ")],
        ),
    ]


def _of_audit(variant: str) -> Section:
    names = ("order", "hack_gap", "touch", "push", "misranked", "kept")
    starts = "the task's own" if variant == "own" else variant.capitalize()
    return Section(
        f"The audit from {starts} starts. Order: share of pairs of synthetic "
        "states that the reward ranks as their true progress does. Hack gap: the lowest reward of "
        "a clear success less the highest reward without progress. Touch, push: largest rise of "
        "the reward by a touch or a wrong push, as a share of its rise by success. Misranked: "
        "share of clear successes whose reward is not above the best state that falls short. Kept: "
        "share of them from which the reward leads uphill to a success.",
        [Column(f"{name}_{variant}", name.replace("_", " ")) for name in names],
    )


def _elsewhere(variants: Sequence[str]) -> list[Section]:
    """Of rewards in variants that their videos do not show."""
    return [
        Section(
            f"The rewards in every variant, on made states, mean over seeds: {what}.",
            [Column(f"{name}_{v}", v.capitalize()) for v in variants],
        )
        for name, what in (
            ("ranks", "how often a success has more reward than another state of the same start"),
            ("best", "how often the state with the highest reward is a success"),
        )
    ]


def _of_variants(lines: Sequence[Line], names: Sequence[str]) -> list[Section]:
    """Of finished policies that have played every variant."""
    start = "played_success_"
    variants = [name.removeprefix(start) for name in names if name.startswith(start)]
    starts = {line["played_starts"] for line in lines if "played_starts" in line}
    counted = f"{min(starts)} starts" if len(starts) == 1 else UNKNOWN
    return [
        Section(
            f"Finished policies in every variant, {counted} of each: {what}.",
            [Column(f"played_{name}_{v}", v.capitalize(), write) for v in variants],
        )
        for name, what, write in (
            ("success", "success in percent, deterministic actions", percent),
            ("sampled", "success in percent, sampled actions", percent),
            ("score", "score at the end, deterministic actions", mean_range),
            ("worst", "mean score of the worst tenth of starts, deterministic", mean_range),
        )
    ]


# --- their cells


def by_row(lines: Sequence[Line], name: str) -> dict[str, Float[np.ndarray, "n"]]:
    """Row to one number of each of its lines; NaN where it is missing."""
    return {row: _column(members, name) for row, members in _rows(lines).items()}


def parts(lines: Sequence[Line], chosen: Sequence[Section]) -> list[Part]:
    """What is known of sections, each published number before ours."""
    found = []
    for caption, columns in chosen:
        columns = [
            one
            for x in columns
            for one in (Column(f"published {x.name}", f"published {x.name.replace('_', ' ')}"), x)
        ]
        every = {
            row: [_cell(members, one) for one in columns] for row, members in _rows(lines).items()
        }
        known = [i for i in range(len(columns)) if any(texts[i] for texts in every.values())]
        cells = {row: [texts[i] for i in known] for row, texts in every.items() if any(texts)}
        if known:
            found.append(Part(caption, [columns[i].heading for i in known], cells))
    return found


def _rows(lines: Sequence[Line]) -> Mapping[str, list[Line]]:
    of: dict[str, list[Line]] = {}
    for line in lines:
        of.setdefault(line["row"], []).append(line)
    return of


def _column(lines: Sequence[Line], name: str) -> Float[np.ndarray, "n"]:
    values = (line.get(name) for line in lines)
    return np.array([np.nan if x is None else x for x in values], np.float64)


def _cell(lines: Sequence[Line], one: Column) -> str:
    said = [line[one.name] for line in lines if isinstance(line.get(one.name), str)]
    if said:  # words, the same in all lines of a row
        return said[0]
    lines = [line for line in lines if not one.among or line.get(one.among) is not None]
    values = _column(lines, one.name)
    known = values[np.isfinite(values)]
    return one.write(known, len(lines)) if len(known) or (one.among and lines) else ""


def markdown(found: Sequence[Part]) -> str:
    """The parts as tables of at most five columns."""
    said = []
    for caption, headings, cells in found:
        said.append(caption)
        for start in range(0, len(headings), _MOST):
            some = slice(start, start + _MOST)
            table = ["| | " + " | ".join(headings[some]) + " |"]
            table.append("|---" * (len(headings[some]) + 1) + "|")
            rows = {row: texts[some] for row, texts in cells.items() if any(texts[some])}
            table += [f"| {row} | " + " | ".join(texts) + " |" for row, texts in rows.items()]
            said.append("\n".join(table))
    return "\n\n".join(said)
