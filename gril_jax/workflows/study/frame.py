"""The frame of every table: it trains, measures, goes on where it stood, and writes.

For each row and seed an encoder is trained where the row learns a reward, then measured, and a
policy is trained with the reward where the table has policies. Seeds share a program, and rows do
that compile alike. All that is written is read from the run's files; it is written again after each
program, so that a run that is cut off leaves what it has.
"""

import dataclasses
import functools
import io
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

import jax

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.demos import schema
from gril_jax.runs import covered, hosts, run_dir
from gril_jax.runs.progress import Progress
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import demonstrations, setup
from gril_jax.workflows.build.demonstrations import Demonstrations

from . import measures as table_measures
from . import programs as table_programs
from . import results
from . import rewards as table_rewards
from .programs import learn_policies
from .results import Echo, Found, Table
from .rewards import TrainedReward, learns, reward_key
from .rows import with_seeds


def make(
    table: Table,
    config: RunConfig,
    settings: Any,
    *,
    resume: Path | None = None,
    echo: Echo = print,
) -> Path:
    """Makes a table, or goes on with the run in the folder `resume`; returns the run's folder.

    Of several processes (`gril_jax.runs.hosts`) the first alone keeps what it writes, and speaks.
    `config` is what all rows have in common, and `settings` the table's own kind; a run that goes
    on has both, too. Raises ConfigError if a row's value is out of range, or if a policy does not
    fit into memory.
    """
    table.prepare(settings, echo)
    rows = with_seeds(table.configs(config, settings), settings.seeds)
    num_classes = len(setup.make_env(config.env, training=False).classes)
    programs = functools.partial(
        table_programs.programs, num_classes=num_classes, devices=jax.devices()
    )
    plan = table.plan(rows, settings, programs)
    counts = {
        "encoders": len({reward_key(row.config) for row in rows if learns(row.config)}),
        "policies": sum(len(program.rows) for program in plan),
        "programs": len(plan),
    }
    opened = {"device": setup.device_in_words(), "experiment": table.name}
    with hosts.scratch() as scratch:
        shown = None
        if scratch is not None:
            own = dataclasses.replace(config.run, out=str(scratch / "run"), sinks=())
            config, resume = dataclasses.replace(config, run=own), None
            echo, shown = (lambda line: None), io.StringIO()
        with (
            run_dir.create_or_resume(config, resume, **opened) as run,
            Progress(stream=shown) as progress,
        ):
            if resume is None:
                run.cover("begun", table.save(run.path, table.name, settings))
            for sentence in run.said:
                echo(sentence)
            said = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
            echo(f"writing to {run.path}: {said}")
            found = _train(table, config, settings, rows, plan, run, progress, echo)
            text = ""
            if hosts.is_first():
                text = _write(table, run, found)
                counts |= table.summary(found)
            run.finish(counts)
    echo(text)
    echo(f"written to {run.path}")
    return run.path


def _train(table: Table, config, settings, rows, plan, run, progress, echo: Echo) -> Found | None:
    """Rewards, measures and policies, in the order in which programs are compiled."""
    finished = hosts.largest([run.finished_phase(program.name) is not None for program in plan])
    left = [program for program, done in zip(plan, finished, strict=True) if not done]
    free = [one for one in left if not any(learns(row.config) for row in one.rows)]
    others = [one for one in left if one not in free]
    learned: dict[Hashable, TrainedReward] = {}
    gather = _gatherer(run, progress)
    demos = gather(config) if table.one_set else None

    def written() -> None:
        if hosts.is_first():
            _write(table, run, results.read(table, run.path, settings), last=False)

    def shown(config: RunConfig) -> DemoBatch:
        return gather(config).batch("train")

    def train(program, compiled) -> None:
        done, saved = learn_policies(program, compiled, learned, shown, run, progress, echo)
        finish(program, run)
        run.finish_phase(program.name, done, saved)
        written()

    with ahead.compiling() as pool:
        # First what needs no reward: it keeps the device at work while all else is compiled.
        ready = table_programs.get_ready(free, jax.devices(), pool)
        wanted = table_rewards.get_ready(rows, gather, pool)
        ready |= table_programs.get_ready(others, jax.devices(), pool)
        measures = table.measures(config, settings, demos)
        finish = table.after(left, settings, pool)
        needs = functools.partial(table_rewards.needed, wanted)
        ahead.carry_out(
            table_rewards.tasks(wanted, learned, run, progress, echo)
            + table_measures.tasks(measures, rows, learned, needs, run, pool, progress, written)
            + table_programs.tasks(left, ready, needs, train)
        )
    if not hosts.is_first():
        return None
    found = results.read(table, run.path, settings)
    return found._replace(lines=[*found.lines, *(table.reference(demos) if demos else [])])


def _write(table: Table, run: run_dir.RunDir, found: Found, *, last: bool = True) -> str:
    """The table, written; runs are joined by its CSV, or by the phases alone."""
    text = results.write(table, run.path, found, last=last)
    if table.joins_csv:
        run.cover("table", [run.path / f"{table.name}.csv"])
    return text


def _gatherer(run: run_dir.RunDir, progress: Progress) -> Callable[[RunConfig], Demonstrations]:
    """Demonstrations for a configuration, each set made once; the run notes the first one."""
    made: dict[Hashable, Demonstrations] = {}

    def gather(config: RunConfig) -> Demonstrations:
        key = (table_rewards.task_key(config), config.demos)
        if key not in made:
            env = setup.make_env(config.env, training=False)
            if not made:
                made[key] = demonstrations.gather_once(config, env, run, progress)
            else:
                folder = run.path / f"demos-{len(made)}"
                covered.require_part(run.path, folder.name)
                made[key] = demonstrations.gather(config, env, folder, progress)
                if not config.demos.path:
                    run.cover(folder.name, [folder / schema.HEADER])
        return made[key]

    return gather
