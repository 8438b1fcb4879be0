"""Which choices of encoder training make a reward sound, and whether an audit tells success.

    gril soundness match_regions --seeds 5 --out RUN
    gril soundness --resume RUN
    gril soundness --join RUN,RUN --out FOLDER       tables of runs with different rows as one

For each row (`gril_jax.experiments.soundness.settings.ROWS`) and each seed an encoder is trained,
audited from Demo and from Layout starts, and a policy is trained with its reward. Seeds and traced
values share a program, and policies of all rows whose encoders have one shape do. Writes
`soundness.csv` (a line an encoder), `soundness.md` (a line a row, and the correlation of each
figure with success) and `soundness.png`. A run that is cut off goes on where it stood.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
from gril_jax.experiments.pipeline import demonstrations, setup
from gril_jax.experiments.sweeps import named_rows, table_csv
from gril_jax.experiments.sweeps import programs as sweep_programs
from gril_jax.experiments.sweeps import rewards as sweep_rewards
from gril_jax.experiments.sweeps.programs import Program
from gril_jax.experiments.sweeps.rewards import LearnedReward, reward_key
from gril_jax.experiments.sweeps.rows import Row, with_seeds
from gril_jax.experiments.sweeps.training import learn_policies

from gril_jax.compilation import ahead, sharding
from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError, RunError
from gril_jax.report import sweep_table
from gril_jax.report.figures.style import png
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress

from . import audit as soundness_audit
from . import plot as soundness_plot
from . import table as soundness_table
from .settings import Settings, read_settings, write_settings

__all__ = ["join", "main"]

Echo = Callable[[str], None]
Rewards = Mapping[Hashable, LearnedReward]

_CSV = "soundness.csv"


def main(
    config: RunConfig, settings: Settings, *, resume: Path | None = None, echo: Echo = print
) -> Path:
    """Run it, or go on with the run in a folder; returns the run's folder.

    Args:
      config: with the budget of a policy; rows change fields of it.
      settings: what is compared.
      resume: folder of a run with this configuration and these settings.
      echo: takes what is said on the way.

    Raises:
      ConfigError: a row's value is out of range, or a policy does not fit into memory.
      DemoError: the demonstrations do not serve the task.
      RunError: the run cannot be made, or cannot go on.
    """
    rows = with_seeds(config, settings.rows, settings.seeds)
    env, variants = setup.make_env(config.env, training=False), soundness_audit.tasks(config.env)
    classes = len(env.classes)
    plan = _programs(rows, classes, settings.policies_at_once) if settings.policies else []
    opened = {"device": setup.device_in_words(), "experiment": "soundness"}
    with run_dir.create_or_resume(config, resume, **opened) as run, Progress() as progress:
        if resume is None:
            write_settings(run.path, settings)
        count = sum(len(program.rows) for program in plan)
        echo(
            f"writing to {run.path}: {len(rows)} encoders, and {count} policies in {len(plan)} "
            "programs"
        )
        demos = demonstrations.gather_once(config, env, run, progress)
        table = _train(rows, plan, variants, demos, settings, run, progress, echo)
        run.finish({"encoders": len(rows), "policies": count})
    echo(table)
    echo(f"written to {run.path}")
    return run.path


def _train(
    rows, plan, variants, demos, settings: Settings, run: run_dir.RunDir, progress, echo
) -> str:
    """All rewards, their audits, and policies, as programs are compiled; returns the table."""
    left = [program for program in plan if run.finished_phase(program.name) is None]
    rewards: dict[Hashable, LearnedReward] = {}

    def write() -> str:
        return _write(run.path, _lines(run, settings, rows, rewards, plan))

    def train(program, compiled) -> None:
        done = learn_policies(program, compiled, rewards, run, progress, echo)
        run.finish_phase(program.name, done)
        write()

    def judge() -> None:
        soundness_audit.audit(audits, rewards, run, progress)
        write()

    with ahead.compiling() as pool:
        wanted = sweep_rewards.get_ready(rows, lambda config: demos, pool)
        ready = sweep_programs.get_ready(left, jax.devices(), pool)
        chosen = {"starts": settings.starts, "ascents": settings.ascents}
        audits = soundness_audit.get_ready(variants, rows, run, pool, **chosen)
        learned = sweep_rewards.tasks(wanted, rewards, run, progress, echo)
        every = frozenset(task.name for task in learned)  # the table has all encoders
        ahead.carry_out(
            learned
            + [ahead.Task("audits", audits.last, every, judge)]
            + sweep_programs.tasks(left, ready, lambda rows: every, train)
        )
    return write()


def join(folders: Sequence[Path], out: Path, *, echo: Echo = print) -> None:
    """Tables and figure of several runs as one, such as of runs with different rows.

    Args:
      folders: of the runs, finished or not.
      out: folder to create.
      echo: takes the table.

    Raises:
      ConfigError: the runs differ in their configurations, or have an encoder in common.
      RunError: a folder is no such run, or has no table yet.
    """
    first, rows = run_dir.read_config(folders[0]), dict[str, Any]()
    for folder in folders:
        rows |= read_settings(folder).rows
    lines: list[dict[str, Any]] = []
    for folder in folders:
        if other := named_rows.differing(first, run_dir.read_config(folder), rows):
            raise ConfigError(f"{folder} cannot be joined with {folders[0]}: {', '.join(other)}")
        try:
            text = (folder / _CSV).read_text(encoding="utf-8")
            lines += table_csv.read(text, soundness_table.COLUMNS)
        except (OSError, ValueError, KeyError, TypeError):
            raise RunError(f"{folder} has no table yet: its {_CSV} is missing or damaged") from None
    known = [(line["row"], line["seed"]) for line in lines]
    twice = next((one for one in known if known.count(one) > 1), None)
    if twice is not None:
        raise ConfigError(f"row {twice[0]!r} with seed {twice[1]} is in two of the runs to join")
    run_dir.require_new(out)
    with run_dir.writing(out):
        out.mkdir(parents=True)
    echo(_write(out, lines))
    echo(f"written to {out}")


def _programs(rows: Sequence[Row], num_classes: int, at_once: int) -> list[Program]:
    """The programs of a sweep, in parts of at most `at_once` policies."""
    found: list[Program] = []
    for program in sweep_programs.programs(rows, num_classes, jax.devices()):
        parts = -(-len(program.rows) // at_once)
        each = -(-len(program.rows) // parts)
        for start in range(0, len(program.rows), each):
            part = program.rows[start : start + each]
            sharding.mesh(jax.devices(), seeds=len(part), num_envs=program.algorithm.num_envs)
            found.append(program._replace(name=f"policy-{len(found)}", rows=part))
    return found


def _write(folder: Path, lines: Sequence[soundness_table.Line]) -> str:
    """Tables and figure of what is known so far; returns the table."""
    table = soundness_table.markdown(lines)
    text = table_csv.written(lines, soundness_table.COLUMNS)
    with run_dir.writing(folder):
        (folder / "soundness.md").write_text(table + "\n", encoding="utf-8")
        (folder / _CSV).write_text(text, encoding="utf-8")
        if any("success" in line for line in lines):
            (folder / "soundness.png").write_bytes(png(soundness_plot.figure(lines)))
    return table


def _lines(
    run: run_dir.RunDir,
    settings: Settings,
    rows: Sequence[Row],
    rewards: Rewards,
    plan: Sequence[Program],
) -> list[dict[str, Any]]:
    """What is known of each encoder, in the order of rows and seeds."""
    scores = _scores(run, plan)
    lines: list[dict[str, Any]] = []
    for row in rows:
        figures = run.finished_phase(f"audit-{row.cell}") or {}
        tau = rewards[reward_key(row.config)].tau
        lines.append(
            {"row": [*settings.rows][row.cell], "seed": row.config.run.seed, "tau": tau}
            | {name: _number(values[row.seed]) for name, values in figures.items()}
            | scores.get((row.cell, row.seed), {})
        )
    return lines


def _scores(
    run: run_dir.RunDir, plan: Sequence[Program]
) -> dict[tuple[int, int], dict[str, float]]:
    """Final scores of the policies that have finished, by row and seed."""
    finished = {program.name: run.finished_phase(program.name) for program in plan}
    metrics = run_dir.read_metrics(run.path) if any(finished.values()) else []
    found = {}
    for name, done in finished.items():
        if done is None:
            continue
        curve = [line for line in metrics if line["phase"] == name]
        for result in sweep_table.results(done["rows"], done["taus"], curve):
            last = {score: float(values[-1]) for score, values in result.scores.items()}
            found[result.cell, result.seed] = {"env_steps": float(result.env_steps[-1])} | last
    return found


def _number(value: float | None) -> float:
    """What was not finite is null in a run's files."""
    return float("nan") if value is None else float(value)
