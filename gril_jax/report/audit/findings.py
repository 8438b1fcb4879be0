"""The findings of an audit: the numbers in its JSON file, lines for the terminal, and states."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gril_jax.audit.measures import Audit, States
from gril_jax.audit.scene_reward import Scene
from gril_jax.audit.states import FACTORS

from .maps import View


class Asked(NamedTuple):
    """The bound of one measure."""

    words: str  # what it is
    bound: str  # what it must be, in words
    holds: Callable[[float], bool]  # whether a value is so; NaN never is


ASKED = {  # what a sound reward reaches
    "order_accuracy": Asked(
        "pairs of states in their true order", "at least 0.97", lambda x: x >= 0.97
    ),
    "hack_gap": Asked("worst success less best state without progress", "above 0", lambda x: x > 0),
    "touch_share": Asked(
        "share of the range for touching everything", "at most 0.05", lambda x: x <= 0.05
    ),
    "push_share": Asked(
        "share of the range for targets at a wrong place", "at most 0.7", lambda x: x <= 0.7
    ),
}


class Findings(NamedTuple):
    """One audit, its arrays on the host."""

    states: States  # leading axis B
    audit: Audit
    names: tuple[str, ...]  # of the N objects
    task: Any  # a `gril_jax.envs.stages.Stages`

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
            "gradient ascent": (found.scene, found.reward),
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
            "sound": {name: asked.holds(numbers[name]) for name, asked in ASKED.items()},
            "best_unearned_state": {"found_by": how, "reward": _plain(reward)} | self._state(scene),
            "worst_pair": {"factor": kind, "lesser": pair[0], "better": pair[1]},
        }

    def in_words(self) -> list[str]:
        """One line for each measure with a requirement."""
        numbers, fault = self.numbers(), "   NOT SOUND"
        return [
            f"{name:15} {numbers[name]:7.3f}  ({asked.bound}) {asked.words}"
            f"{'' if asked.holds(numbers[name]) else fault}"
            for name, asked in ASKED.items()
        ]

    def view(self, title: str, scene: Scene) -> View:
        """A state to draw."""
        return View(title, scene.center, scene.size, scene.active)

    def _state(self, scene: Scene) -> dict[str, Any]:
        rows = zip(self.names, scene.center, scene.active, strict=True)
        return {
            "objects": [
                {"name": name, "center": [round(float(x), 4) for x in c], "active": bool(active)}
                for name, c, active in rows
            ]
        }


def _only(reward: np.ndarray, where: np.ndarray) -> np.ndarray:
    return np.where(where, reward, -np.inf)


def _pick(scenes: Scene, at: tuple[int, ...]) -> Scene:
    return Scene(*(leaf[at] for leaf in scenes))


def _plain(value: float) -> float | None:
    return round(value, 5) if math.isfinite(value) else None
