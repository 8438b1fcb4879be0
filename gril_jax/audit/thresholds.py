"""The thresholds of audits: one table of figures for a task, and one for videos alone.

Terminal, JSON file, report and Python read them here, and `docs/audit.md` and `docs/metrics.md` are
tested against them. A reward passes if each figure keeps its threshold; an unknown one does not.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple


class Threshold(NamedTuple):
    """The bound of one figure of an audit."""

    direction: str  # "at least", "above" or "at most"
    limit: float
    unit: str
    words: str  # what the figure is
    short: str

    @property
    def bound(self) -> str:
        """The threshold in words, such as "at most 0.05"."""
        return f"{self.direction} {self.limit:g}"

    def holds(self, value: float) -> bool:
        """True if a value keeps the threshold; NaN never does."""
        return {
            "at least": value >= self.limit,
            "above": value > self.limit,
            "at most": value <= self.limit,
        }[self.direction]


Table = Mapping[str, Threshold]  # by the name of the figure

_RANGE = "share of the range"
TASK: Table = {
    "order_accuracy": Threshold(
        "at least", 0.97, "share of pairs", "pairs of states in their true order", "order"
    ),
    "hack_gap": Threshold(
        "above", 0.0, "reward", "worst clear success less best state without progress", "hack gap"
    ),
    "touch_share": Threshold("at most", 0.05, _RANGE, "rise for touching everything", "touch"),
    "push_share": Threshold(
        "at most", 0.7, _RANGE, "rise for targets at a wrong place", "push"
    ),
    "misranked_share": Threshold(
        "at most", 0.05, "share of clear successes",
        "successes that are not above the best state that falls short", "misranked",
    ),
    "success_kept": Threshold(
        "at least", 0.98, "share of clear successes",
        "successes from which the reward leads to a success", "success kept",
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
        "at least", 0.6, "alignment tau", "alignment of held-out videos in time", "alignment tau"
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
    worst: str = ""  # kind of shortfall that misranks most, of `gril_jax.audit.shortfalls.KINDS`

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

    def words(self, name: str) -> str:
        """The meaning of a figure, with the worst kind where successes are misranked."""
        named = self.worst and name == "misranked_share" and self.value(name) > 0
        return self.table[name].words + (f", {self.worst}" if named else "")

    def lines(self) -> list[str]:
        """A line for each figure: its value, its threshold, its meaning, and whether it fails."""
        return [
            f"{name:16} {self.value(name):7.3f}  ({one.bound}; {one.unit}) {self.words(name)}"
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
        """The verdict, with the reasons if it is bad."""
        table, bad = self.table, self.faults
        reasons = "; ".join(
            f"{self.words(name)}: {self.value(name):.3g}, but {table[name].bound} is asked "
            f"({table[name].unit})"
            for name in bad
        )
        audit = {"task": "its audit", "videos": "the audit of the videos alone"}[self.kind]
        if bad:
            said = [f"Fails {audit}: {reasons}."]
        else:
            said = [f"Passes {audit}: all {len(table)} figures keep their thresholds."]
        if self.kind == "videos":
            said.append("No state was searched, because videos do not define success.")
        return " ".join(said)

    def as_json(self) -> dict[str, Any]:
        """The kind, the verdict, whether each figure passes, and the thresholds."""
        return {
            "kind": self.kind,
            "audit": NAMES[self.kind],
            "passed": self.passes,
            "verdict": self.sentence(),
            "passes": {name: name not in self.faults for name in self.table},
            "thresholds": {
                name: {
                    "direction": one.direction,
                    "limit": one.limit,
                    "unit": one.unit,
                    "meaning": one.words,
                }
                for name, one in self.table.items()
            },
        }
