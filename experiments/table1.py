"""The paper's Table I and Figure 2: one task, one learner, one budget, and eleven rewards.

    gril table1                               five seeds; sized for a GPU
    gril table1 --demos HUMAN --seeds 10
    gril table1 --quick                       two rows and two seeds of one block, on a laptop
    gril table1 --resume RUN

For each row (`gril_jax.experiments.table1_rows.ROWS`) and seed an encoder is trained where the row
learns a reward, audited, and a policy is trained with that reward; seeds share a program, and rows
do whose rewards compile alike. Writes `table1.md`, `table1.csv` (a line a policy), `figure2.png`
and `report.html` after each program. A run that is cut off goes on where it stood.
"""

import dataclasses
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax

from gril_jax import run_dir
from gril_jax.config import RunConfig
from gril_jax.plot_style import png
from gril_jax.progress import Progress
from gril_jax.report_data import read_versions
from gril_jax.sweep_grid import with_seed

from . import demonstrations, setup, soundness_audit, table1_page, table1_plot, table1_table
from .ablate import changed
from .sweep_rewards import LearnedReward, learn_rewards, reward_key
from .sweep_rows import Row
from .sweep_training import Program, learn_policies, programs
from .table1_profiles import profiles
from .table1_rows import Settings, write_settings
from .table1_scores import STARTS, Curve, curves, in_last_tenth, summary

__all__ = ["main"]

Echo = Callable[[str], None]
Rewards = Mapping[Hashable, LearnedReward]


def main(
    config: RunConfig, settings: Settings, *, resume: Path | None = None, echo: Echo = print
) -> Path:
    """Run it, or go on with the run in a folder; returns the run's folder.

    Args:
      config: what all rows have in common; each changes fields of it.
      settings: the rows, and how many seeds.
      resume: folder of a run with this configuration and these settings.
      echo: takes what is said on the way.

    Raises:
      ConfigError: a row's value is out of range, or a policy does not fit into memory.
      DemoError: the demonstrations do not serve the task.
      RunError: the run cannot be made, or cannot go on.
    """
    rows = [
        Row(cell, seed, with_seed(changed(config, change), seed))
        for cell, change in enumerate(settings.rows.values())
        for seed in range(settings.seeds)
    ]
    env = setup.make_env(config.env, training=False)
    plan = programs(rows, len(env.classes), jax.devices(), starts=STARTS)
    opened = {"device": setup.device_in_words(), "experiment": "table1"}
    with run_dir.create_or_resume(config, resume, **opened) as run, Progress() as progress:
        if resume is None:
            write_settings(run.path, settings)
        echo(f"writing to {run.path}: {len(rows)} policies in {len(plan)} programs")
        demos = demonstrations.gather_once(config, env, run, progress)
        rewards = _rewards(rows, demos, run, progress, echo)
        _look_at(rows, rewards, demos, settings, run, progress)
        table = ""
        for program in plan:
            if run.finished_phase(program.name) is None:
                done = learn_policies(program, dict(rewards), run, progress, echo, jax.devices())
                run.finish_phase(program.name, done)
            table = _write(run, settings, rows, rewards, plan)
        run.finish(_results(run, settings, rows, rewards, plan))
    echo(table)
    echo(f"written to {run.path}")
    return run.path


def _rewards(rows: Sequence[Row], demos, run, progress, echo) -> Rewards:
    """The reward of each row that learns one; rows that learn the same share it."""
    learning = [row._replace(config=_as_learned(row.config)) for row in _learning(rows)]
    found = learn_rewards(learning, lambda config: demos, run, progress, echo)
    return {
        reward_key(row.config): found[reward_key(_as_learned(row.config))]
        for row in _learning(rows)
    }


def _learning(rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.config.run.reward != "environmental"]


def _as_learned(config: RunConfig) -> RunConfig:
    """Without what its encoder does not depend on: how the task pays, and what becomes of that."""
    usual = RunConfig()
    env = dataclasses.replace(config.env, reward=usual.env.reward)
    run = dataclasses.replace(config.run, reward="learned")
    return dataclasses.replace(config, env=env, run=run)


def _look_at(
    rows: Sequence[Row], rewards: Rewards, demos, settings: Settings, run, progress: Progress
) -> None:
    """Audits and profiles; the audit has states of graphs, and no pictures of them."""
    graphs = [row for row in _learning(rows) if row.config.encoder.kind != "pixels"]
    if not graphs:
        return
    start = STARTS[0]
    variants = {start: soundness_audit.tasks(graphs[0].config.env)[start]}
    work = {"starts": settings.starts, "ascents": settings.ascents}
    soundness_audit.audit(variants, graphs, rewards, run, progress, **work)
    profiles(graphs, rewards, demos, run, progress)


def _curves(run: run_dir.RunDir, settings: Settings, plan: Sequence[Program]) -> list[Curve]:
    """Of the policies that have finished, in the order of the rows and seeds."""
    names = [*settings.rows]
    found: list[Curve] = []
    metrics = run_dir.read_metrics(run.path)
    for program in plan:
        done = run.finished_phase(program.name)
        if done is not None:
            lines = [line for line in metrics if line["phase"] == program.name]
            found += curves(names, done["rows"], lines)
    return sorted(found, key=lambda curve: (names.index(curve.row), curve.seed))


def _lines(run, settings: Settings, rows: Sequence[Row], rewards: Rewards, found: Sequence[Curve]):
    """What is known of each policy that has finished."""
    names, lines = [*settings.rows], []
    of = {(row.cell, row.seed): row for row in rows}
    for curve in found:
        row = of[names.index(curve.row), curve.seed]
        line: dict[str, Any] = {"row": curve.row, "seed": row.config.run.seed} | summary(curve)
        if row.config.run.reward != "environmental":
            line["tau"] = rewards[reward_key(row.config)].tau
            audit = run.finished_phase(f"audit-{row.cell}") or {}
            looks = run.finished_phase(f"profiles-{row.cell}") or {}
            figures = audit | {name: looks[name] for name in ("cycle",) if name in looks}
            # What was not finite is null in a run's files.
            line |= {k: x[row.seed] for k, x in figures.items() if x[row.seed] is not None}
        lines.append(line)
    return lines


def _write(run, settings: Settings, rows, rewards: Rewards, plan: Sequence[Program]) -> str:
    """Tables, figure and page of what has finished so far; returns the table."""
    found = _curves(run, settings, plan)
    lines = _lines(run, settings, rows, rewards, found)
    evaluations = int(in_last_tenth(found[0].env_steps).sum())
    table = table1_table.markdown(lines, _about(run), evaluations=evaluations)
    figure = png(table1_plot.figure(found))
    looks = {
        name: looks
        for cell, name in enumerate(settings.rows)
        if (looks := run.finished_phase(f"profiles-{cell}")) is not None
    }
    page = table1_page.page(lines, table, figure, looks, _about(run))
    with run_dir.writing(run.path):
        (run.path / "table1.md").write_text(table + "\n", encoding="utf-8")
        (run.path / "table1.csv").write_text(table1_table.csv(lines), encoding="utf-8")
        (run.path / "figure2.png").write_bytes(figure)
        (run.path / "report.html").write_text(page, encoding="utf-8")
    return table


def _about(run: run_dir.RunDir) -> dict[str, Any]:
    """What was run: command, versions, device, date, and the digest of the demonstrations."""
    demos = run.finished_phase("demos") or {}
    return read_versions(run.path) | {"demos_sha256": demos.get("sha256", "")}


def _results(run, settings: Settings, rows, rewards: Rewards, plan) -> dict[str, Any]:
    lines = _lines(run, settings, rows, rewards, _curves(run, settings, plan))
    shown = ("success", "success_sampled")
    means = {
        name: {x: sum(m[x] for m in lines if m["row"] == name) / settings.seeds for x in shown}
        for name in settings.rows
    }
    return {"policies": len(rows), "programs": len(plan), "rows": means} | _about(run)
