"""The results of a study, read from the files of its run and of its parts."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from gril_jax.report import headline
from gril_jax.report.data import read_versions
from gril_jax.runs import json_lines, run_dir
from gril_jax.runs.reading import read_phases
from gril_jax.workflows.build.given import of_all

from . import measured, saved
from .counted import Counted
from .curves import Curve, curves, numbers
from .failures import PHASE
from .measured.audit import FIGURES
from .saved import Plan
from .written import Line

PASSES = "passes"  # 1 in the line of a reward that keeps the bounds of its audit, 0 in others


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
    def starts(self) -> Mapping[str, Counted]:
        """The starts of each policy's evaluations, by variant; empty if not recorded of all."""
        each = [curve.starts for curve in self.curves]
        return each[0] if each and all(one == each[0] for one in each) else {}

    @property
    def columns(self) -> list[str]:
        """The columns of the lines: of policies, then what was measured."""
        whole = sorted(self.lines, key=lambda line: "env_steps" not in line)
        return [*dict.fromkeys(["row", "seed", *(name for line in whole for name in line)])]


class _Own(NamedTuple):
    """The results that one run has, of the study or of a part, by the places of row and seed."""

    lines: dict[tuple[int, int], dict[str, Any]]
    curves: list[Curve]
    profiles: dict[tuple[int, int], Mapping[str, Any]]
    failed: dict[int, str]
    about: dict[str, Any]


def read(folder: Path) -> Found:
    """The results that the files of a study hold; RunError if one is missing or damaged."""
    plan = saved.read(folder)
    each, work = [_own(folder, plan)], {name: [*seeds] for name, seeds in plan.work.items()}
    for part in saved.parts(folder):
        own = saved.read(part)
        each.append(_own(part, own))
        for name, seeds in own.work.items():
            work[name] = sorted({*work.get(name, ()), *seeds})
    names = [*plan.rows]
    plan = plan._replace(work={name: work[name] for name in names if name in work})
    lines = {at: line for one in each for at, line in one.lines.items()}
    shown = {(curve.cell, curve.seed): curve for one in each for curve in one.curves}
    traces = [(at, x) for one in each for at, x in one.profiles.items()]
    traces.sort(key=lambda one: (one[0][0], -one[0][1]))  # of each row the first seed's last
    profiles = {names[cell]: x for (cell, _), x in traces}
    failed = {names[cell]: said for one in each for cell, said in sorted(one.failed.items())}
    about, digests = each[0].about, [one.about["demos_sha256"] for one in each]
    about["demos_sha256"] = next(filter(None, digests), "")
    if shown:
        about["given"] = of_all(plan.rows[name] for name in plan.work)
    start = plan.config.run.seed
    ordered = [
        {"row": names[cell], "seed": start + seed} | line | _passes(line)
        for (cell, seed), line in sorted(lines.items(), key=lambda one: one[0])
    ]
    of = [shown[at] for at in sorted(shown)]
    return Found(plan, ordered, of, profiles, failed, about)


def _own(folder: Path, plan: Plan) -> _Own:
    phases = read_phases(folder).finished
    trained = any(name.startswith("policy-") for name in phases)
    found = curves(phases, run_dir.read_metrics(folder) if trained else [])
    lines: dict[tuple[int, int], dict[str, Any]] = {}
    for curve in found:
        tau = {} if curve.tau is None else {"tau": curve.tau}
        lines[curve.cell, curve.seed] = numbers(curve) | tau
    profiles = {}
    for cell, name in enumerate(plan.rows):
        for kind in measured.NUMBERS:
            done = phases.get(f"{kind}-{cell}")
            if done is not None:
                for seed, values in zip(
                    plan.work[name], measured.by_seed(kind, done), strict=False
                ):
                    lines.setdefault((cell, seed), {}).update(values)
                if kind == "profiles":
                    profiles[cell, plan.work[name][0]] = done
    for name, done in phases.items():
        if name.startswith("variants-"):
            for i, (cell, seed) in enumerate(done["rows"]):
                values = {what: x[i] for what, x in done["numbers"].items()}
                lines.setdefault((cell, seed), {}).update(values)
    failed = {int(cell): said for cell, said in phases.get(PHASE, {}).items()}
    about = read_versions(folder) | {"started": json_lines.started(folder)}
    about |= {"demos_sha256": phases.get("demos", {}).get("sha256", "")}
    return _Own(lines, found, profiles, failed, about)


def _passes(line: Line) -> dict[str, float]:
    """1 if the reward keeps all bounds of the audit from the first variant, 0 if not; empty if it
    was not audited."""
    first = next((name[6:] for name in line if name.startswith("order_")), None)
    if first is None:
        return {}
    audited = {long: line.get(f"{name}_{first}", float("nan")) for name, long in FIGURES.items()}
    return {PASSES: float(not headline.faults(audited))}
