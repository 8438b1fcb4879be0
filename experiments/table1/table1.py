"""The paper's Table I and Figure 2: one task, one learner, one budget, and thirteen rewards.

    gril table1                               five seeds; sized for a GPU
    gril table1 --demos HUMAN --seeds 10
    gril table1 --quick                       two rows and two seeds of one block, on a laptop
    gril table1 --resume RUN
    gril table1 --join RUN,RUN --out FOLDER      runs with different rows as one table

For each row (`gril_jax.experiments.table1.rows.ROWS`) and seed an encoder is trained where the row
learns a reward, audited, and a policy is trained with that reward; seeds share a program, and rows
do whose rewards compile alike. Writes `table1.md` and `table1.csv` (a line a policy) after each
program, `figure2.png` and `report.html` at the end. A run that is cut off goes on where it stood;
`gril report RUN` draws what there is of it.
"""

import dataclasses
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import jax
from gril_jax.experiments.pipeline import demonstrations, setup
from gril_jax.experiments.soundness import audit as soundness_audit
from gril_jax.experiments.sweeps import programs as sweep_programs
from gril_jax.experiments.sweeps import rewards as sweep_rewards
from gril_jax.experiments.sweeps.rewards import LearnedReward, reward_key
from gril_jax.experiments.sweeps.rows import Row, with_seeds
from gril_jax.experiments.sweeps.training import learn_policies

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress

from . import profiles as table1_profiles
from . import results as table1_results
from . import table as table1_table
from .rows import Settings, write_settings
from .scores import STARTS

__all__ = ["join", "main"]

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
    rows = with_seeds(config, settings.rows, settings.seeds)
    env = setup.make_env(config.env, training=False)
    plan = sweep_programs.programs(rows, len(env.classes), jax.devices(), starts=STARTS)
    opened = {"device": setup.device_in_words(), "experiment": "table1"}
    with run_dir.create_or_resume(config, resume, **opened) as run, Progress() as progress:
        if resume is None:
            write_settings(run.path, settings)
        echo(f"writing to {run.path}: {len(rows)} policies in {len(plan)} programs")
        demos = demonstrations.gather_once(config, env, run, progress)
        _train(rows, plan, demos, settings, run, progress, echo)
        found = table1_results.read(run.path)
        table = table1_results.write(run.path, found)
        run.finish({"programs": len(plan)} | _summary(found))
    echo(table)
    echo(f"written to {run.path}")
    return run.path


def _train(rows, plan, demos, settings: Settings, run: run_dir.RunDir, progress, echo) -> None:
    """All rewards, their audits, and policies, in the order in which programs are compiled."""
    left = [program for program in plan if run.finished_phase(program.name) is None]
    free = [program for program in left if not any(map(_learns, program.rows))]
    others = [program for program in left if any(map(_learns, program.rows))]
    graphs = [row for row in rows if _learns(row) and row.config.encoder.kind != "pixels"]
    learned: dict[Hashable, LearnedReward] = {}

    def train(program, compiled) -> None:
        rewards = _of_rows(program.rows, learned)
        done = learn_policies(program, compiled, rewards, run, progress, echo)
        run.finish_phase(program.name, done)
        table1_results.write_table(run.path, table1_results.read(run.path))

    def judge() -> None:
        rewards = _of_rows(graphs, learned)
        soundness_audit.audit(audits, rewards, run, progress)
        table1_profiles.profiles(looks, rewards, run, progress)

    with ahead.compiling() as pool:
        # First what needs no reward: it keeps the device at work while all else is compiled.
        ready = sweep_programs.get_ready(free, jax.devices(), pool)
        wanted = sweep_rewards.get_ready(_learning(rows), lambda config: demos, pool)
        ready |= sweep_programs.get_ready(others, jax.devices(), pool)
        audits = _audits(graphs, settings, run, pool)
        classes = len(demos.demo_set.classes)
        looks = table1_profiles.get_ready(graphs, demos, classes, run, pool)
        last = looks[-1].ready if looks else audits.last
        needs = lambda rows: sweep_rewards.needed(wanted, _learning(rows))  # noqa: E731
        ahead.carry_out(
            sweep_rewards.tasks(wanted, learned, run, progress, echo)
            + [ahead.Task("audits and profiles", last, needs(graphs), judge)]
            + sweep_programs.tasks(left, ready, needs, train)
        )


def _of_rows(rows: Sequence[Row], learned: Rewards) -> Rewards:
    """Rewards by what each row's own configuration says; rows that learn the same share one."""
    pairs = zip(_learning(rows), [row for row in rows if _learns(row)], strict=True)
    return {
        reward_key(row.config): learned[reward_key(as_learned.config)] for as_learned, row in pairs
    }


def _learns(row: Row) -> bool:
    return row.config.run.reward != "environmental"


def _learning(rows: Sequence[Row]) -> list[Row]:
    """Those that learn a reward, as that is learned."""
    return [row._replace(config=_as_learned(row.config)) for row in rows if _learns(row)]


def _as_learned(config: RunConfig) -> RunConfig:
    """Without what its encoder does not depend on: how the task pays, and what becomes of that."""
    usual = RunConfig()
    env = dataclasses.replace(config.env, reward=usual.env.reward)
    run = dataclasses.replace(config.run, reward="learned")
    return dataclasses.replace(config, env=env, run=run)


def _audits(
    graphs: Sequence[Row], settings: Settings, run: run_dir.RunDir, pool: Executor
) -> soundness_audit.Audits:
    """Audits from the first kind of start; they have states of graphs, and no pictures of them."""
    start, work = STARTS[0], {"starts": settings.starts, "ascents": settings.ascents}
    variants = {start: soundness_audit.tasks(graphs[0].config.env)[start]} if graphs else {}
    return soundness_audit.get_ready(variants, graphs, run, pool, **work)


def _summary(found: table1_results.Results) -> dict[str, Any]:
    rows: dict[str, list[table1_table.Line]] = {}
    for line in found.lines:
        rows.setdefault(line["row"], []).append(line)
    shown = ("success", "success_sampled")
    means = {
        row: {name: sum(line[name] for line in lines) / len(lines) for name in shown}
        for row, lines in rows.items()
    }
    return {"policies": len(found.lines), "rows": means} | found.about


def join(folders: Sequence[Path], out: Path, *, echo: Echo = print) -> None:
    """Tables, figure and page of several runs as one, such as of runs with different rows.

    Args:
      folders: of the runs, finished or not.
      out: folder to create.
      echo: takes the table.

    Raises:
      ConfigError: the runs do not go together.
      RunError: a folder is no such run, or has nothing yet.
    """
    found = table1_results.join(folders)
    run_dir.require_new(out)
    with run_dir.writing(out):
        out.mkdir(parents=True)
    echo(table1_results.write(out, found))
    echo(f"written to {out}")
