"""The thresholds of audits: one table of figures for a task, and one for videos alone.

Terminal, JSON file, report and Python read them here, and `docs/audit.md` and `docs/metrics.md` are
tested against them. A reward passes if each figure keeps its threshold; an unknown one does not.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Threshold(NamedTuple):
    """The bound of one figure of an audit."""

    direction: str  # "at least", "above" or "at most"; "" for a figure without a threshold
    limit: float
    unit: str
    words: str  # what the figure is
    short: str
    why: str = ""  # the reason for having no threshold

    @property
    def bound(self) -> str:
        """The threshold in words, such as "at most 0.05"."""
        return f"{self.direction} {self.limit:g}" if self.direction else "no threshold"

    def holds(self, value: float) -> bool:
        """True if a value keeps the threshold; NaN never does, where there is one."""
        return {
            "at least": value >= self.limit,
            "above": value > self.limit,
            "at most": value <= self.limit,
            "": True,
        }[self.direction]


Table = Mapping[str, Threshold]  # by the name of the figure

_RANGE = "share of the range"
TASK: Table = {
    "order_accuracy": Threshold(
        "at least", 0.97, "share of pairs", "pairs of states in their true order", "order"
    ),
    "hack_gap": Threshold(
        "above", 0.0, "reward", "worst success less best state without progress", "hack gap"
    ),
    "touch_share": Threshold("at most", 0.05, _RANGE, "rise for touching everything", "touch"),
    "push_share": Threshold(
        "at most", 0.7, _RANGE, "rise for targets at a wrong place", "push"
    ),
    "misranked_share": Threshold(
        "", 0.0, "share of successes",
        "all successes that are not above the best state without progress", "misranked",
        "a task's success ends at an edge, and no continuous reward tells the two sides of an edge "
        "apart",
    ),
}  # fmt: skip
VIDEOS: Table = {
    "touch_share": Threshold("at most", 0.05, _RANGE, "rise for touching everything", "touch"),
    "misranked_share": Threshold(
        "at most", 0.02, "share of scenes",
        "scenes with something out of place that are above the worst held-out end", "misranked",
    ),
    "best_amiss_share": Threshold(
        "at most", 1.0, _RANGE, "reward of the best scene with something out of place",
        "best misplaced",
    ),
    "missing_share": Threshold(
        "at most", 0.3, "share of frames", "frames without a box of the object seen least",
        "missing boxes",
    ),
    "tau": Threshold(
        "at least", 0.6, "Kendall's tau", "alignment of held-out videos in time", "tau"
    ),
    "consistency": Threshold(
        "at most", 0.05, "squared share of a video", "loss that aligns videos, at the end of "
        "training (chance: 0.083)", "alignment loss",
    ),
}  # fmt: skip

TABLES: Mapping[str, Table] = {"task": TASK, "videos": VIDEOS}
NAMES = {  # of each kind of audit
    "task": "audit of the reward in its task",
    "videos": "audit of the videos alone: no state was searched",
}
_FROM_TRAINING = ("tau", "consistency")  # not known of a reward that does not tell its training


class Audited(NamedTuple):
    """The figures of one audit beside their thresholds."""

    kind: str  # "task" or "videos"
    numbers: Mapping[str, float | None]

    @property
    def table(self) -> Table:
        """The thresholds of the figures that this audit has."""
        left_out = [name for name in _FROM_TRAINING if self.numbers.get(name) is None]
        return {name: x for name, x in TABLES[self.kind].items() if name not in left_out}

    @property
    def faults(self) -> list[str]:
        """The figures that do not keep their thresholds; one that is not known does not.

        >>> Audited("videos", dict.fromkeys(VIDEOS, 0.0)).faults
        ['tau']
        """
        return [name for name, one in self.table.items() if not one.holds(self.value(name))]

    @property
    def passes(self) -> bool:
        """True if all figures keep their thresholds."""
        return not self.faults

    def value(self, name: str) -> float:
        """A figure; NaN if it is not known."""
        value = self.numbers.get(name)
        return float("nan") if value is None else float(value)

    def lines(self) -> list[str]:
        """A line for each figure: its value, its threshold, its meaning, and whether it fails."""
        return [
            f"{name:16} {self.value(name):7.3f}  ({one.bound}; {one.unit}) {one.words}"
            f"{'   FAILS' if name in self.faults else ''}"
            for name, one in self.table.items()
        ]

    def in_short(self) -> str:
        """The figures with their thresholds, such as "order 0.999 (at least 0.97)"."""
        return "; ".join(
            f"{one.short} {self.value(name):.{3 if name == 'order_accuracy' else 2}f} "
            f"({'FAILS, ' * (name in self.faults)}{one.bound})"
            for name, one in self.table.items()
        )

    def sentence(self) -> str:
        """The verdict, with the reasons if it is bad, and with what has no threshold."""
        table, bad = self.table, self.faults
        reasons = "; ".join(
            f"{table[name].words}: {self.value(name):.3g}, but {table[name].bound} is asked "
            f"({table[name].unit})"
            for name in bad
        )
        audit = {"task": "its audit", "videos": "the audit of the videos alone"}[self.kind]
        if bad:
            said = [f"Fails {audit}: {reasons}."]
        else:
            asked = sum(bool(one.direction) for one in table.values())
            said = [f"Passes {audit}: all {asked} figures keep their thresholds."]
        if self.kind == "videos":
            said.append("No state was searched, because videos do not define success.")
        said += [
            f"{name} has no threshold, because {one.why}."
            for name, one in table.items()
            if not one.direction
        ]
        return " ".join(said)

    def as_json(self) -> dict[str, Any]:
        """The kind, the verdict, whether each figure passes, and the thresholds."""
        asked = {name: one for name, one in self.table.items() if one.direction}
        return {
            "kind": self.kind,
            "audit": NAMES[self.kind],
            "passed": self.passes,
            "verdict": self.sentence(),
            "passes": {name: name not in self.faults for name in asked},
            "thresholds": {
                name: {
                    "direction": one.direction or None,
                    "limit": one.limit if one.direction else None,
                    "unit": one.unit,
                    "meaning": one.words,
                }
                | ({"why": one.why} if one.why else {})
                for name, one in self.table.items()
            },
        }
