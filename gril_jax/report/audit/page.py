"""The page of an audit: its numbers, the heat maps, and the states that the reward gets wrong."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gril_jax.audit.states import FACTORS
from gril_jax.report.figures.style import png
from gril_jax.report.headline import Tile, Verdict
from gril_jax.report.html import Part, render, save

from .findings import ASKED, Findings
from .maps import Situation, reward_maps, state_pictures


def write_report(folder: Path, found: Findings, results: Mapping[str, Any], *, title: str) -> Path:
    """Writes and returns `report.html`, a self-contained page, and its pictures beside it;
    `results` are what `audit.json` holds."""
    page = render(
        title=title,
        summary="Made-up states with known true progress, and a search for states that the reward "
        "overestimates. Its range is that from a reset to a success.",
        verdict=_verdict(found),
        tiles=_tiles(found),
        film=_unearned(folder, found),
        beside=[_pair(folder, found), _maps(folder, found)],
        sections=[],
        facts={name: str(value) for name, value in results["settings"].items()},
        tables={
            "Pairs in order, by what was changed": _texts(results["factor_accuracy"]),
            "Largest rise by one object at a place without progress, share of the range":
                _texts(results["alone_share"]),
            "All numbers": _texts(found.numbers()),
        },
        listings={"audit.json": json.dumps(results, indent=2)},
    )  # fmt: skip
    save(folder / "report.html", page.encode("utf-8", "replace"))
    return folder / "report.html"


def _verdict(found: Findings) -> Verdict:
    numbers = found.numbers()
    faults = sum(not asked.holds(numbers[name]) for name, asked in ASKED.items())
    if faults:
        return Verdict("bad", f"Not sound: {faults} of {len(ASKED)} measures are not as asked.")
    return Verdict("good", f"Sound: all {len(ASKED)} measures are as asked.")


def _tiles(found: Findings) -> list[Tile]:
    numbers, tiles = found.numbers(), []
    for name, asked in ASKED.items():
        note = f"{'' if asked.holds(numbers[name]) else 'not '}sound; {asked.bound} is asked"
        tiles.append(Tile(f"{numbers[name]:.3f}", asked.words, note))
    return tiles


def _unearned(folder: Path, found: Findings) -> Part:
    how, scene, reward = found.best_unearned()
    numbers = found.numbers()
    made = found.states.battery
    start, done = (_first(found, kind) for kind in ("start", "success"))
    views = [
        found.view(f"reset: {numbers['start_reward']:.3f}", start),
        found.view(f"best without progress: {reward:.3f}", scene),
        found.view("a success", done),
    ]
    pictures = state_pictures(views, found.names, half_extent=found.task.half_extent)
    return Part(
        f"The most overestimated state without progress, found by {how}, gets {reward:.3f}: "
        f"{numbers['hack_share']:.0%} of the range. The worst of "
        f"{int((made.score >= 0.999).sum())} successes, other objects untouched, gets "
        f"{numbers['worst_success']:.3f}. Thick boxes have their activity bit set.",
        save(folder / "hack.png", png(pictures)),
        "Three states as boxes: a reset, the most overestimated one without progress, a success",
    )


def _maps(folder: Path, found: Findings) -> Part:
    start, done = (_first(found, kind) for kind in ("start", "success"))
    situations = [
        Situation(found.view("others at the start", start), found.audit.rewards.alone[0, 0]),
        Situation(found.view("others as in a success", done), found.audit.rewards.alone[0, 1]),
    ]
    figure = reward_maps(situations, found.names, found.swept, half_extent=found.task.half_extent)
    return Part(
        "The reward with one object's centre at each place of the plane and the others where the "
        "white boxes are; the dot is where the object itself was. A target's map should be bright "
        "in its region alone, and the other maps should be flat outside it.",
        save(folder / "maps.png", png(figure)),
        "Heat maps of the reward over the place of each object",
    )


def _pair(folder: Path, found: Findings) -> Part:
    kind, pair = found.worst_pair()
    if found.numbers()["worst_violation"] == 0:
        return Part("Every pair of states is in its true order.")
    views = [found.view(f"true progress {q:.2f}: reward {r:.3f}", s) for s, q, r in pair]
    figure = state_pictures(views, found.names, half_extent=found.task.half_extent)
    return Part(
        f"The two states ({kind}) whose rewards contradict their true progress most, by "
        f"{found.numbers()['worst_violation']:.0%} of the range.",
        save(folder / "worst_pair.png", png(figure)),
        "Two states as boxes, of which the left one has the higher reward and less progress",
    )


def _first(found: Findings, kind: str):
    """The first state of a factor, from the first start."""
    made = found.states.battery
    index = int((made.factor[0] == FACTORS.index(kind)).argmax())
    return type(made.scenes)(*(leaf[0, index] for leaf in made.scenes))


def _texts(rows: Mapping[str, float | None]) -> dict[str, str]:
    return {name: "-" if value is None else f"{value:.4f}" for name, value in rows.items()}
