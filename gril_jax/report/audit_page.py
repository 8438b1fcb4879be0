"""The page of an audit in a task: its findings, as numbers in a JSON file, words and pictures."""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gril_jax.audit.made import Judged, States
from gril_jax.audit.measures import Audit
from gril_jax.audit.scene_reward import Scene, StagedTask
from gril_jax.audit.shortfalls import KINDS, UNCLEAR
from gril_jax.audit.states import FACTORS
from gril_jax.audit.thresholds import Audited

from .audit_maps import Situation, reward_maps, state_pictures
from .film_audit_page import figure_table
from .headline import audit_verdict
from .html import Cell, Part, Section, Table, render, save
from .style import png


class State(NamedTuple):
    """One state that an audit found."""

    how: str  # it was found
    scene: Scene
    reward: float


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

    def best_unearned(self) -> State:
        """The most overestimated state without progress."""
        return self._highest(lambda made: made.nothing)

    def shortfalls(self) -> dict[str, tuple[float, State]]:
        """By kind of shortfall: the share of successes that it misranks, and its best state; the
        worst kind comes first, and one of which no state was found is left out."""
        shares = zip(KINDS, self.audit.measures.misranked, strict=True)
        found = {
            kind: (float(share), self._highest(lambda made, i=i: made.kind == i))
            for i, (kind, share) in enumerate(shares)
        }
        found = {kind: one for kind, one in found.items() if one[1].reward > -np.inf}
        worst_first = sorted(found.items(), key=lambda x: (-x[1][0], -x[1][1].reward))
        return dict(worst_first)

    def worst_success(self) -> tuple[Scene, float]:
        """The sampled clear success of lowest reward, and its reward."""
        paid = np.where(self.states.succeeds, self.audit.rewards.successes, np.inf)
        at = _at(paid, np.argmin)
        return _pick(self.states.successes, at), float(paid[at])

    def _highest(self, chosen: Callable[[Judged], np.ndarray]) -> State:
        found, paid = self.audit.found, self.audit.rewards
        kinds = np.where(found.reward == -np.inf, UNCLEAR, np.arange(len(KINDS)))
        battery, alone, pushed = self.states.judged()
        of = {
            "gradient search": (Judged(found.scene, found.score, kinds), found.reward),
            "battery": (battery, paid.battery),
            "one object moved": (alone, paid.alone),
            "targets pushed": (pushed, paid.pushed),
        }
        only = {how: np.where(chosen(made), reward, -np.inf) for how, (made, reward) in of.items()}
        how = max(only, key=lambda how: only[how].max())
        at = _at(only[how], np.argmax)
        return State(how, _pick(of[how][0].scene, at), float(only[how][at]))

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
            "misranked": {k: _plain(share) for k, (share, _) in self.shortfalls().items()},
            "worst_kind": self.audited().worst,
            "worst_states": {k: self._found(state) for k, (_, state) in self.shortfalls().items()},
            "best_unearned_state": self._found(self.best_unearned()),
            "worst_pair": {"factor": kind, "lesser": pair[0], "better": pair[1]},
        }

    def audited(self) -> Audited:
        """The figures beside their thresholds."""
        return Audited("task", self.numbers(), next(iter(self.shortfalls()), ""))

    def in_words(self) -> list[str]:
        """The verdict, and a line for each figure."""
        found = self.audited()
        return [found.sentence(), *found.lines()]

    def write_report(self, folder: Path, results: Mapping[str, Any], *, title: str) -> Path:
        """Writes and returns the page of the audit, see `write_report`."""
        return write_report(folder, self, results, title=title)

    def _found(self, state: State) -> dict[str, Any]:
        return {"found_by": state.how, "reward": _plain(state.reward)} | self._state(state.scene)

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
        film=_worst(folder, found),
        beside=[_pair(folder, found), _maps(folder, found)],
        sections=[
            Section("Figures and thresholds", [figure_table(found.audited())]),
            Section("Kinds of shortfall", [_kinds(found)]),
        ],
        facts={name: str(value) for name, value in results["settings"].items()},
        tables={
            "Pairs in order, by what was changed": _texts(results["factor_accuracy"]),
            "Largest rise by one object at a place without progress, share of the range":
                _texts(results["alone_share"]),
            "All numbers": _texts({
                name: x for name, x in results.items() if x is None or type(x) in (int, float)
            }),
        },
        listings={"audit.json": json.dumps(results, indent=2)},
    )  # fmt: skip
    save(folder / "report.html", page.encode("utf-8", "replace"))
    return folder / "report.html"


def _worst(folder: Path, found: Findings) -> Part:
    numbers, (success, lowest) = found.numbers(), found.worst_success()
    kind, (share, state) = next(iter(found.shortfalls().items()))
    states = [
        (f"reset: {numbers['start_reward']:.3f}", _first(found, "start")),
        (f"{kind}: {state.reward:.3f}", state.scene),
        (f"lowest success: {lowest:.3f}", success),
    ]
    pictures = state_pictures(states, found.names, half_extent=found.task.half_extent)
    return Part(
        f'The worst kind of shortfall is "{kind}". Its best state, found by {state.how}, gets '
        f"{state.reward:.3f}; {share:.1%} of {int(found.states.succeeds.sum())} clear successes "
        f"are not above it, and the lowest of them gets {lowest:.3f}. Thick boxes have their "
        "activity bit set.",
        save(folder / "worst.png", png(pictures)),
        f"Three states as boxes: a reset, the most overestimated state ({kind}), a success",
    )


def _kinds(found: Findings) -> Table:
    """The kinds of shortfall, the worst first."""
    rows = {
        kind: [Cell(f"{share:.3f}"), Cell(f"{state.reward:.3f}"), Cell(state.how)]
        for kind, (share, state) in found.shortfalls().items()
    }
    return Table(
        "The best state of each kind that was found, by its reward.",
        ("misranked successes", "highest reward", "found by"), rows,
    )  # fmt: skip


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


def _at(values: np.ndarray, which: Callable[[np.ndarray], Any]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.unravel_index(which(values), values.shape))


def _pick(scenes: Scene, at: tuple[int, ...]) -> Scene:
    return Scene(*(leaf[at] for leaf in scenes))


def _plain(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None
