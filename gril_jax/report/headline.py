"""The verdict and the numbers at the top of a report, in words, and how sure they are.

A field of `results.json` that is no number, or a rate not from 0 to 1, is a `RunError`.
"""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

from gril_jax.audit.thresholds import NAMES, TABLES, Audited
from gril_jax.config.tables import alternatives
from gril_jax.errors import RunError

from .data import number
from .rates import WHERE, Rate, name, own_start, rates, wilson

_SOLVED = 0.9  # success rate from which a run is said to have worked


class Tile(NamedTuple):
    """One number, its meaning, and a number to compare it with."""

    value: str
    label: str
    note: str = ""


class Verdict(NamedTuple):
    """One sentence on how it went."""

    grade: str  # "good", "fair", "bad", or "open" where there is nothing to judge yet
    text: str


def verdict(results: Mapping[str, Any]) -> Verdict:
    """A sentence on whether the run worked, judged by the success of its policy and, where that is
    high, by the audit of its reward."""
    if not results:
        return Verdict("open", "The run has not finished, so it has no results yet.")
    known = rates(results)
    if "success" not in known:
        tau = number(results, "tau", WHERE)
        said = "" if tau is None else f": alignment tau on held-out demonstrations is {tau:.3f}"
        audited = audit_of(results)
        if audited is None:
            return Verdict("open", f"A reward was learned{said}.")
        grade, text = audit_verdict(audited)
        return Verdict(grade, f"A reward was learned{said}. {text}")
    rate, random = known["success"], known.get("success_random")
    against = "" if random is None else f"; a random policy: {random.value} of {random.counted}"
    if rate.single:
        found = f"{rate.value} from the task's one start{against}"
    else:
        found = f"{rate.tally} end in success{against}"
    if rate.value == "success" or (rate.share >= _SOLVED and not rate.single):
        audited = audit_of(results)
        if audited and not audited.passes:
            return Verdict("fair", f"It worked: {found}. But its reward fails its audit.")
        return Verdict("good", f"It worked: {found}.")
    if _better(rate, random):
        return Verdict("fair", f"It works in part: {found}.")
    return Verdict("bad", f"It did not work: {found}.")


def _better(rate: Rate, random: Rate | None) -> bool:
    """True if a policy is surely better than a random one."""
    least = rate.interval[0] if rate.interval else rate.share
    if random is None:
        return least > (wilson(0.0, rate.starts)[1] if rate.interval else 0.0)
    return least > (random.interval[1] if random.interval else random.share)


def headline(results: Mapping[str, Any]) -> list[Tile]:
    """Tiles of the numbers in `results.json`; missing numbers have none."""
    get = functools.partial(number, results, where=WHERE)
    others = (
        (get("tau"), ".3f", "alignment tau",
         "on demonstrations kept aside; 1 is perfect, 0 is chance"),
        (get("reward_time_tau"), ".3f", "Kendall's tau of reward and time",
         "1 if the reward never falls along a demonstration"),
        (get("env_steps"), ",.0f", "environment steps", ""),
        (get("trimmed_frames"), ",.0f", "frames trimmed",
         "cut from ends of videos in which nothing moves"),
    )  # fmt: skip
    success = success_tiles(results)
    return (
        success[:2]
        + audit_tiles(results)
        + success[2:]
        + [
            Tile(format(value, shape), label, note)
            for value, shape, label, note in others
            if value is not None
        ]
    )


def success_tiles(results: Mapping[str, Any]) -> list[Tile]:
    """Tiles of the success rates, each with what it counts, and of the task's own start."""
    known, own = rates(results), own_start(results)
    tiles = {field: Tile(rate.value, name(field), _note(rate)) for field, rate in known.items()}
    last = [tiles.pop(field) for field in ("success_random",) if field in tiles]
    tiles.pop("success_ever", None)
    alone = [Tile(own, "the task's own start", "with deterministic actions")] if own else []
    return [*tiles.values(), *alone, *last]


def audit_tiles(results: Mapping[str, Any]) -> list[Tile]:
    """A tile of the reward's audit; of a run that has none, where to get it."""
    found, label = audit_of(results), "the reward, by its audit"
    if found is not None:
        alone = "" if found.kind == "task" else " of the videos alone"
        value = "passes" if found.passes else "fails"
        return [Tile(value, label + alone, found.in_short())]
    if number(results, "tau", WHERE) is None:
        return []
    note = "gril audit RUN searches for states that the reward overestimates"
    return [Tile("not audited", label, note)]


def _note(rate: Rate) -> str:
    if rate.interval is None:
        return rate.tally
    low, high = (100 * bound for bound in rate.interval)
    return f"{rate.tally}; 95% Wilson interval {low:.1f}% to {high:.1f}%"


def in_words(seconds: int | float) -> str:
    """A duration in plain words.

    >>> in_words(4.26), in_words(251), in_words(7500)
    ('4.3 s', '4 min 11 s', '2 h 5 min')
    """
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def audit_kept(results: Mapping[str, Any]) -> dict[str, Any]:
    """The part of `audit.json` that a run keeps in its results."""
    kind = results.get("kind", "task")
    figures = {name: results.get(name) for name in TABLES[kind]}
    worst = {"worst_kind": results["worst_kind"]} if results.get("worst_kind") else {}
    return {"kind": kind} | figures | worst | {"settings": results.get("settings")}


def audit_of(results: Mapping[str, Any]) -> Audited | None:
    """The figures of a run's own audit, in its `results.json`; None without one."""
    found = results.get("audit")
    if not isinstance(found, Mapping):
        return None
    kind = found.get("kind", "task")
    if kind not in TABLES:
        raise RunError(f"results.json, audit: kind must be {alternatives([*TABLES])}")
    where = "results.json, audit"
    figures = {name: number(found, name, where) for name in TABLES[kind]}
    return Audited(kind, figures, str(found.get("worst_kind", "")))


def audit_sentence(results: Mapping[str, Any]) -> str:
    """A run's audit in one line."""
    found = audit_of(results)
    if found is None:
        return "audit: none; gril audit RUN searches for states that the reward overestimates"
    alone = "" if found.kind == "task" else f", {NAMES[found.kind]}"
    return f"audit: {'passes' if found.passes else 'fails'} ({found.in_short()}){alone}"


def audit_verdict(found: Audited) -> Verdict:
    """The verdict of an audit."""
    return Verdict("good" if found.passes else "bad", found.sentence())
