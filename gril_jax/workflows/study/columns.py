"""The sections of a study's table, chosen by what was measured."""

from collections.abc import Sequence

from gril_jax.report.rates import UNKNOWN

from .counted import Counted, in_words, of_lines, solved
from .measured import evaluation, separation
from .results import PASSES, Found
from .written import SEEDS, Column, Line, Section, mean_interval, mean_range, median_reached

_percent = mean_interval(digits=1, unit=100.0)
_share = mean_interval(middle=False)
_steps = median_reached(unit=1e-6, digits=2)


def _count(values, count: int) -> str:
    return f"{int(values.sum())} of {count}"


def sections(found: Found) -> list[Section]:
    """All sections; columns of which no line has a number are left out where they are written."""
    published = found.plan.study.published
    made = [*_of_policies(found), *_of_rewards(found.lines), *_of_variants(found.lines)]
    return [
        Section(caption, [two for one in columns for two in _with_published(one, published)])
        for caption, columns in made
    ]


def _with_published(one: Column, published) -> list[Column]:
    known = Column(f"published {one.name}", f"published {one.name.replace('_', ' ')}")
    return [known, one] if one.name in published else [one]


# --- policies


def order_of_starts(found: Found) -> list[tuple[str, str]]:
    """The variants of evaluations, the one that tells most first, with what stands behind the names
    of their scores."""
    variants = [*found.starts] or [""]
    suffixes = ["" if not i else f"_{variant}" for i, variant in enumerate(variants)]
    first = found.curves[0].headline if found.curves else ""
    return sorted(zip(variants, suffixes, strict=True), key=lambda pair: pair[1] != first)


def among(found: Found, variant: str, suffix: str, *, sampled: bool = False) -> str:
    """The starts that the success from a variant counts, in words."""
    if suffix:
        return in_words(found.starts, variant, sampled=sampled)
    return of_lines(found.lines, variant, sampled=sampled)


def _of_policies(found: Found) -> list[Section]:
    (first, *others), made = order_of_starts(found), []
    counted = among(found, *first)
    made.append(
        Section(
            "Success in percent: mean; interquartile mean and its 95 % bootstrap interval over "
            "policies, each of which is one observation: the mean over the evaluations in the last "
            "tenth of its training, each from fresh starts.",
            [
                SEEDS._replace(heading="policies", among="env_steps"),
                *_success(found, *first),
                Column(f"success_ever{first[1]}", f"success at some moment, {counted}", _percent),
                Column(f"score{first[1]}", "score, deterministic actions", mean_interval()),
            ],
        )
    )
    made.append(
        Section(
            "Million env steps to the first evaluation with so much success (sampled actions): the "
            "median over policies, of which those that never got there come last, and how many "
            "got there.",
            [
                Column(f"steps_{level}", f"to {level} % of {counted}", _steps, among="env_steps")
                for level in (50, 80, 95)
            ],
        )
    )
    for variant, suffix in others:
        caption = f"Success from {variant.capitalize()} starts, percent:"
        made.append(Section(caption, _success(found, variant, suffix)))
    return made


def _success(found: Found, variant: str, suffix: str) -> list[Column]:
    """Success with deterministic and with sampled actions; of one start, who solves it."""
    counted, played = (among(found, variant, suffix, sampled=x) for x in (False, True))
    single = counted == Counted(1, 1).in_words(variant)
    words, write = ("", solved) if single else ("success, ", _percent)
    return [
        Column(f"success{suffix}", f"{words}deterministic actions, {counted}", write),
        Column(f"success{suffix}_sampled", f"success, sampled actions, {played}", _percent),
    ]


def _of_variants(lines: Sequence[Line]) -> list[Section]:
    """Of finished policies that have played every variant."""
    known = dict.fromkeys(x for line in lines for x in line if x.startswith("played_success_"))
    variants = [name.removeprefix("played_success_") for name in known]
    starts = {line["played_starts"] for line in lines if "played_starts" in line}
    counted = f"{min(starts)} starts" if len(starts) == 1 else UNKNOWN
    return [
        Section(
            f"Finished policies in every variant, {counted} of each: {what}.",
            [Column(f"played_{name}_{v}", v.capitalize(), write) for v in variants],
        )
        for name, what, write in (
            ("success", "success in percent, deterministic actions", _percent),
            ("sampled", "success in percent, sampled actions", _percent),
            ("score", "score at the end, deterministic actions", mean_range),
            ("clumped", "share of episodes that end with all blocks in a clump", mean_range),
        )
    ]


# --- rewards


def _of_rewards(lines: Sequence[Line]) -> list[Section]:
    names = dict.fromkeys(name for line in lines for name in line)
    audited = [x.removeprefix("order_") for x in names if x.startswith("order_")]
    kinds = [name for name in names if name.startswith("auc ")]
    return [
        Section(
            "The learned rewards, mean over seeds (lowest to highest), on demonstrations kept "
            "aside: Kendall's tau, cycle consistency, tau of reward and time, the last reward; and "
            "how many keep the bounds of their audit.",
            [
                SEEDS._replace(heading="rewards", among="tau"),
                Column("tau", "tau"),
                Column("cycle", "cycle consistency"),
                *map(Column, evaluation.NUMBERS[1:], ("reward against time", "last reward")),
                Column(PASSES, "pass their audit", _count, among=PASSES),
            ],
        ),
        *(_of_audit(variant) for variant in audited),
        *_OF_SEPARATION,
        Section(
            "AUC of the last reward, successes against failures of each kind:",
            [Column(name, name.removeprefix("auc "), _share) for name in kinds],
        ),
    ]


def _of_audit(variant: str) -> Section:
    names = ("order", "hack_gap", "touch", "push", "outbid")
    return Section(
        f"The audit from {variant.capitalize()} starts. Order: share of pairs of made-up states "
        "whose rewards are in the order of their true progress. Hack gap: the reward of the worst "
        "success, of those well inside, less that of the best state without progress. Touch, push: "
        "what the best touch or wrong push gains, as a share of what success gains. Outbid: share "
        "of all successes with no higher reward than the best state without progress.",
        [Column(f"{name}_{variant}", name.replace("_", " ")) for name in names],
    )


_OF_SEPARATION = (
    Section(
        "Mean over seeds (95 % bootstrap interval of the interquartile mean). rho (Eq. 8) is the "
        "mean |cumulative reward| of held-out successes over that of failures, lower is better. A "
        "sum depends on how long a recording is, and failures are often short. held: what a "
        "recording ends with goes on to the length of the longest; resampled: each is stretched "
        "to that length; natural: as it is. The paper does not say which is its own.",
        [Column(name, name.replace("_", ", "), _share) for name in separation.NUMBERS[:3]],
    ),
    Section(
        "AUC: how often a success is above a failure, by the reward of its last frame or by its "
        "held sum. Order of stages: Somers' D of the reward with the number of stages done, "
        "held-out successes.",
        [
            Column("auc_final", "AUC, last reward", _share),
            Column("auc_held", "AUC, held sum", _share),
            Column("order", "order of stages", _share),
        ],
    ),
)
