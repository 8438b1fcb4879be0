"""The results of a study, read from the files of its run and of its parts.

A line is of one row and seed: `row`, `seed`, and what was measured; what is not known is missing or
NaN. A policy is one observation, whose success is a share of the distinct starts of an evaluation.
Shapes use E for the evaluations of a policy while it is trained.
"""

import csv as csv_format
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from gril_jax.audit.thresholds import Audited
from gril_jax.report.data import read_versions
from gril_jax.report.rates import UNKNOWN, Rate
from gril_jax.runs import json_lines, run_dir
from gril_jax.runs.reading import read_phases
from gril_jax.workflows.build.given import of_all

from . import saved
from .audit import FIGURES
from .programs import Counted
from .recipe import MEASURES
from .saved import Plan

PASSES = "passes"  # 1 in the line of a reward that keeps the bounds of its audit, 0 in others
FAILED = "failed"  # a phase: a sentence for each row that failed, by the row's place
LEVELS = (50, 80, 95)  # percent of success that is waited for

Line = Mapping[str, Any]


@dataclass(frozen=True)
class Curve:
    """The learning curve of one policy."""

    cell: int  # place of its row
    seed: int  # place of its seed
    tau: float | None  # of its reward; None where none is learned
    env_steps: Float[np.ndarray, "E"]
    scores: Mapping[str, Float[np.ndarray, "E"]]  # as `programs.learn_policies` names them
    starts: Mapping[str, Counted] = field(default_factory=dict)
    """Of each evaluation, by variant, that of the first scores first; empty if not recorded."""

    @property
    def headline(self) -> str:
        """The suffix of the most informative scores, such as "_jitter"; "" for the first variant.

        They are those of the first variant that has several starts."""
        several = [name for name, counted in self.starts.items() if counted.distinct > 1]
        return "" if not several or several[0] == next(iter(self.starts)) else f"_{several[0]}"


class Found(NamedTuple):
    """The results of the rows and seeds that have finished, in the order of the study."""

    plan: Plan  # its work is that of the parts, too
    lines: list[Line]
    curves: list[Curve]  # of the policies
    profiles: Mapping[str, Mapping[str, Any]]  # of a row's rewards along demonstrations
    failed: Mapping[str, str]  # row to a sentence on what went wrong
    about: Mapping[str, Any]  # command, versions, device, date, and the demonstrations' digest

    @property
    def names(self) -> list[str]:
        """All rows of the study."""
        return [*self.plan.rows]

    @property
    def starts(self) -> dict[str, str]:
        """The variants of evaluations, the one that tells most first, with what stands behind the
        names of their scores."""
        variants = [*self.curves[0].starts] if self.curves else []
        suffixes = {x: f"_{x}" if i else "" for i, x in enumerate(variants or [""])}
        first = self.curves[0].headline if self.curves else ""
        return dict(sorted(suffixes.items(), key=lambda pair: pair[1] != first))

    def counted(self, variant: str, *, sampled: bool = False) -> str:
        """What success from a variant counts, in words, such as "256 Jitter starts"."""
        each = [curve.starts.get(variant) for curve in self.curves]
        if not each or None in each:
            return UNKNOWN
        few, many = min(each, key=lambda x: x.distinct), max(each, key=lambda x: x.distinct)
        said = Rate(0.0, many.distinct, many.episodes, sampled, variant).counted
        return said if few.distinct == many.distinct else f"{few.distinct} to {said}"

    @property
    def csv(self) -> str:
        """The lines as CSV: the numbers of policies, then what was measured; what is not known or
        not finite is empty."""
        whole = sorted(self.lines, key=lambda line: "env_steps" not in line)
        names = dict.fromkeys(["row", "seed", *(name for line in whole for name in line)])
        columns = sorted(names, key=lambda name: name.startswith("published "))
        file = io.StringIO()
        writer = csv_format.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([_in_csv(line.get(name)) for name in columns] for line in self.lines)
        return file.getvalue()


def _in_csv(value: Any) -> Any:
    if isinstance(value, str | int):
        return value
    return f"{value:.6g}" if value is not None and np.isfinite(value) else ""


def read(folder: Path) -> Found:
    """The results that the files of a study hold; RunError if one is missing or damaged."""
    plan = saved.read(folder)
    names, work = [*plan.rows], {name: [*seeds] for name, seeds in plan.work.items()}
    lines: dict[tuple[int, int], dict[str, Any]] = {}
    shown, profiles, failed = {}, {}, {}
    about = read_versions(folder) | {"started": json_lines.started(folder), "demos_sha256": ""}
    for one in (folder, *saved.parts(folder)):
        own = saved.read(one)
        for name, seeds in own.work.items():
            work[name] = sorted({*work.get(name, ()), *seeds})
        phases = read_phases(one).finished
        about["demos_sha256"] = about["demos_sha256"] or phases.get("demos", {}).get("sha256", "")
        for curve in curves(one, phases):
            shown[curve.cell, curve.seed] = curve
            tau = {} if curve.tau is None else {"tau": curve.tau}
            lines.setdefault((curve.cell, curve.seed), {}).update(numbers(curve) | tau)
        for at, values in _measured(own, phases):
            lines.setdefault(at, {}).update(values)
        for cell, name in enumerate(names):
            if done := phases.get(f"profiles-{cell}"):
                profiles.setdefault(cell, []).append((own.work[name][0], done))
        failed |= {names[int(cell)]: said for cell, said in phases.get(FAILED, {}).items()}
    plan = plan._replace(work={name: work[name] for name in names if name in work})
    if shown:
        about["given"] = of_all(plan.rows[name] for name in plan.work)
    start, ordered = plan.config.run.seed, []
    for (cell, seed), line in sorted(lines.items(), key=lambda one: one[0]):
        row = names[cell]
        published = {
            f"published {x}": str(of[row]) for x, of in plan.study.published.items() if row in of
        }
        ordered.append({"row": row, "seed": start + seed} | line | _passes(line) | published)
    first = {names[k]: min(x, key=lambda one: one[0])[1] for k, x in sorted(profiles.items())}
    return Found(plan, ordered, [shown[at] for at in sorted(shown)], first, failed, about)


def _measured(
    plan: Plan, phases: Mapping[str, Any]
) -> Iterator[tuple[tuple[int, int], dict[str, float]]]:
    """What was measured of each row and seed of one run; what was not finite is left out."""
    for cell, name in enumerate(plan.rows):
        for kind in ("tau", *MEASURES):
            done = phases.get(f"{kind}-{cell}", {})
            lists = {k: x for k, x in done.items() if _are_numbers(x)}
            for i, seed in enumerate(plan.work.get(name, ())):
                known = {k: x[i] for k, x in lists.items() if i < len(x) and x[i] is not None}
                if known:
                    yield (cell, seed), known
    for phase, done in phases.items():
        if phase.startswith("variants-"):
            program = phases.get(phase.removeprefix("variants-"))
            if program is None:  # a run that was cut off between the two
                continue
            lost = program.get("diverged", {})
            for i, (cell, seed) in enumerate(done["rows"]):
                if str(i) in lost:
                    continue
                yield (cell, seed), {what: x[i] for what, x in done["numbers"].items()}


def _are_numbers(values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(x, float | int | None) for x in values)


def _passes(line: Line) -> dict[str, float]:
    """1 if the reward keeps all bounds of the audit from the first variant, 0 if not; empty if it
    was not audited."""
    first = next((name[6:] for name in line if name.startswith("order_")), None)
    if first is None:
        return {}
    audited = {long: line.get(f"{name}_{first}", float("nan")) for name, long in FIGURES.items()}
    return {PASSES: float(Audited("task", audited).passes)}


# --- policies


def curves(folder: Path, phases: Mapping[str, Mapping[str, Any]]) -> list[Curve]:
    """The policies of a run that have finished, by row and seed.

    In the lines of metrics.jsonl a score has one number for each policy of the program.
    """
    trained = {name: done for name, done in phases.items() if name.startswith("policy-")}
    metrics = run_dir.read_metrics(folder) if trained else []
    found = []
    for phase, done in trained.items():
        own = [x for x in metrics if x["phase"] == phase and "success_sampled" in x]
        lines = [*{x["env_steps"]: x for x in own}.values()]  # the later one of a second try
        named = [name for name, value in lines[-1].items() if isinstance(value, list)]
        values = {name: np.array([line[name] for line in lines], float) for name in named}
        steps = np.array([line["env_steps"] for line in lines], float)
        starts = {variant: Counted(**x) for variant, x in done.get("starts", {}).items()}
        for i, ((cell, seed), tau) in enumerate(zip(done["rows"], done["taus"], strict=True)):
            if str(i) in done.get("diverged", {}):
                continue
            own = {name: x[:, i] for name, x in values.items()}
            found.append(Curve(cell, seed, tau, steps, own, starts))
    return sorted(found, key=lambda curve: (curve.cell, curve.seed))


def numbers(curve: Curve) -> dict[str, float]:
    """A policy's scores: the means over the evaluations in the last tenth of its training.

    Also the number of starts of one evaluation, and the steps to levels of success."""
    last = in_last_tenth(curve.env_steps)
    found = {name: float(values[last].mean()) for name, values in curve.scores.items()}
    found["env_steps"] = float(curve.env_steps[-1])
    for counted in [*curve.starts.values()][:1]:
        found |= {"starts": counted.distinct, "episodes": counted.episodes}
    success = curve.scores[f"success{curve.headline}_sampled"]
    for level in LEVELS:
        found[f"steps_{level}"] = first_at(success, curve.env_steps, level=level / 100)
    return found


def first_at(success: Float[np.ndarray, "E"], at: Float[np.ndarray, "E"], *, level: float) -> float:
    """The first of `at` with this share of success, not interpolated; NaN if never reached."""
    reached = success >= level - 1e-6  # shares are float32
    return float(at[np.argmax(reached)]) if reached.any() else float("nan")


def in_last_tenth(env_steps: Float[np.ndarray, "E"]) -> Bool[np.ndarray, "E"]:
    """True for evaluations after nine tenths of the training; for the last one always."""
    return env_steps > 0.9 * env_steps[-1]
