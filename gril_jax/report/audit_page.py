"""The page of an audit: its findings, as numbers in a JSON file, as words and as pictures."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gril_jax.audit.measures import Audit, States, clear_successes
from gril_jax.audit.scene_reward import Scene, StagedTask
from gril_jax.audit.states import FACTORS
from gril_jax.audit.thresholds import NAMES, Audited

from .audit_maps import Situation, reward_maps, state_pictures
from .headline import audit_verdict
from .html import Cell, Part, Section, Table, render, save
from .style import png


class Findings(NamedTuple):
    """One audit, its arrays on the host."""

    states: States  # leading axis B
    audit: Audit
    names: tuple[str, ...]  # of the N objects
    task: StagedTask

    @property
    def swept(self) -> tuple[int, ...]:
        """The objects that the maps are of."""
        return (*self.task.movable, *self.task.robots)

    def numbers(self) -> dict[str, float]:
        """The scalar measures."""
        found = self.audit.measures._asdict()
        return {k: float(v) for k, v in found.items() if v.ndim == 0 and k != "finite"}

    def best_unearned(self) -> tuple[str, Scene, float]:
        """The most overestimated state without progress: how it was found, itself, its reward."""
        states, paid, found = self.states, self.audit.rewards, self.audit.found
        kinds = {
            "gradient search": (found.scene, found.reward),
            "battery": (states.battery.scenes, _only(paid.battery, states.battery.score <= 0)),
            "one object moved": (states.alone, _only(paid.alone, states.alone_free)),
            "targets pushed": (states.pushed, _only(paid.pushed, states.pushed_free)),
        }
        how = max(kinds, key=lambda kind: kinds[kind][1].max())
        scenes, reward = kinds[how]
        at = tuple(int(i) for i in np.unravel_index(np.argmax(reward), reward.shape))
        return how, _pick(scenes, at), float(reward[at])

    def worst_pair(self) -> tuple[str, list[tuple[Scene, float, float]]]:
        """The worst-ordered pair of states: its factor; then the lesser and the better state, each
        with its true progress and its reward."""
        start, *pair = (int(i) for i in self.audit.measures.worst_pair)
        made, paid = self.states.battery, self.audit.rewards.battery
        places = [(start, i) for i in pair]
        sides = [(_pick(made.scenes, p), float(made.score[p]), float(paid[p])) for p in places]
        return FACTORS[int(made.factor[start, max(pair)])], sides

    def as_json(self) -> dict[str, Any]:
        """Everything as JSON; undefined values are null."""
        found = self.audit.measures
        numbers = self.numbers()
        how, scene, reward = self.best_unearned()
        kind, sides = self.worst_pair()
        pair = [self._state(s) | {"progress": q, "reward": _plain(r)} for s, q, r in sides]
        moved = zip(self.swept, found.alone_share, strict=True)
        return {
            **{name: _plain(value) for name, value in numbers.items()},
            "factor_accuracy": {
                name: _plain(float(value))
                for name, value in zip(FACTORS, found.factor_accuracy, strict=True)
                if np.isfinite(value)
            },
            "alone_share": {self.names[i]: _plain(float(share)) for i, share in moved},
            **self.audited().as_json(),
            "best_unearned_state": {"found_by": how, "reward": _plain(reward)} | self._state(scene),
            "worst_pair": {"factor": kind, "lesser": pair[0], "better": pair[1]},
        }

    def audited(self) -> Audited:
        """The figures beside their thresholds."""
        return Audited("task", self.numbers())

    def in_words(self) -> list[str]:
        """The verdict, and a line for each figure that has a threshold or tells why not."""
        found = self.audited()
        return [found.sentence(), *found.lines()]

    def write_report(self, folder: Path, results: Mapping[str, Any], *, title: str) -> Path:
        """Writes and returns the page of the audit, see `write_report`."""
        return write_report(folder, self, results, title=title)

    def _state(self, scene: Scene) -> dict[str, Any]:
        rows = zip(self.names, scene.center, scene.active, strict=True)
        return {
            "objects": [
                {"name": name, "center": [round(float(x), 4) for x in c], "active": bool(active)}
                for name, c, active in rows
            ]
        }


def write_report(folder: Path, found: Findings, results: Mapping[str, Any], *, title: str) -> Path:
    """Writes and returns `report.html`, a self-contained page, and its pictures beside it;
    `results` are what `audit.json` holds."""
    page = render(
        title=title,
        summary="Made-up states with known true progress, and a search for states that the reward "
        "overestimates. Its range is that from a reset to a success.",
        verdict=audit_verdict(found.audited()),
        tiles=[],
        film=_unearned(folder, found),
        beside=[_pair(folder, found), _maps(folder, found)],
        sections=[Section("Figures and thresholds", [figure_table(found.audited())])],
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


def figure_table(found: Audited) -> Table:
    """The figures of an audit with their thresholds."""
    rows = {
        name: [
            Cell(f"{found.value(name):.3f}", one.unit),
            Cell(one.bound),
            Cell("FAILS" if name in found.faults else "passes" if one.direction else "-", one.why),
            Cell(one.words),
        ]
        for name, one in found.table.items()
    }
    caption = f"The figures of the {NAMES[found.kind]}."
    return Table(caption, ("value", "threshold", "result", "meaning"), rows)


def _unearned(folder: Path, found: Findings) -> Part:
    how, scene, reward = found.best_unearned()
    numbers = found.numbers()
    made = found.states.battery
    start, done = (_first(found, kind) for kind in ("start", "success"))
    states = [
        (f"reset: {numbers['start_reward']:.3f}", start),
        (f"no progress: {reward:.3f}", scene),
        ("a success", done),
    ]
    pictures = state_pictures(states, found.names, half_extent=found.task.half_extent)
    return Part(
        f"The most overestimated state without progress, found by {how}, gets {reward:.3f}: "
        f"{numbers['hack_share']:.0%} of the range. The worst of "
        f"{int(clear_successes(made).sum())} clear successes, other objects untouched, gets "
        f"{numbers['worst_success']:.3f}. Thick boxes have their activity bit set.",
        save(folder / "hack.png", png(pictures)),
        "Three states as boxes: a reset, the most overestimated one without progress, a success",
    )


def _maps(folder: Path, found: Findings) -> Part:
    start, done = (_first(found, kind) for kind in ("start", "success"))
    situations = [
        Situation("others at the start", start, found.audit.rewards.alone[0, 0]),
        Situation("others as in a success", done, found.audit.rewards.alone[0, 1]),
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
    states = [(f"true progress {q:.2f}: reward {r:.3f}", s) for s, q, r in pair]
    figure = state_pictures(states, found.names, half_extent=found.task.half_extent)
    return Part(
        f"The two states ({kind}) whose rewards contradict their true progress most, by "
        f"{found.numbers()['worst_violation']:.0%} of the range.",
        save(folder / "worst_pair.png", png(figure)),
        "Two states as boxes, of which the left one has the higher reward and less progress",
    )


def _first(found: Findings, kind: str) -> Scene:
    """The first state of a factor, from the first start."""
    made = found.states.battery
    return _pick(made.scenes, (0, int((made.factor[0] == FACTORS.index(kind)).argmax())))


def _texts(rows: Mapping[str, float | None]) -> dict[str, str]:
    return {name: "-" if value is None else f"{value:.4f}" for name, value in rows.items()}


def _only(reward: np.ndarray, where: np.ndarray) -> np.ndarray:
    return np.where(where, reward, -np.inf)


def _pick(scenes: Scene, at: tuple[int, ...]) -> Scene:
    return Scene(*(leaf[at] for leaf in scenes))


def _plain(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None


def write_videos_report(
    folder: Path,
    scenes: Sequence[tuple[str, Scene]],
    names: Sequence[str],
    results: Mapping[str, Any],
    *,
    half_extent: float,
    title: str,
) -> Path:
    """Writes and returns `report.html` of an audit of videos alone, and its picture beside it.

    Args:
      scenes: titled states to show.
      names: of their objects.
      results: what `audit.json` holds.
    """
    found = Audited("videos", results)
    picture = png(state_pictures(scenes, names, half_extent=half_extent))
    page = render(
        title=title,
        summary=f"This is the {NAMES['videos']}. Its scenes are the first and last frames of "
        "held-out videos, with activity bits set or objects displaced. Its range is that from "
        "first to last frames.",
        verdict=audit_verdict(found),
        tiles=[],
        film=Part(
            "The scenes with the lowest and the highest reward that should be otherwise. Thick "
            "boxes have their activity bit set.",
            save(folder / "scenes.png", picture),
            "A held-out end, and the scene with something out of place of the highest reward",
        ),
        sections=[Section("Figures and thresholds", [figure_table(found)])],
        facts={name: str(value) for name, value in results["settings"].items()},
        tables={"All numbers": {
            name: f"{value:.4f}" for name, value in results.items() if type(value) in (int, float)
        }},
        listings={"audit.json": json.dumps(results, indent=2)},
    )  # fmt: skip
    save(folder / "report.html", page.encode("utf-8", "replace"))
    return folder / "report.html"
