"""The paper's Table II: whether learned rewards tell success from failure on a long task.

    gril table2 --seeds 5 --out RUN           five encoders a row; sized for a GPU
    gril table2 --quick --out RUN             two a row from fewer demonstrations, on a laptop
    gril table2 --resume RUN

For each row (`gril_jax.experiments.table2.rows.ROWS`) and seed an encoder is trained; seeds share
a program, and so do rows that compile alike. Its reward is measured along successes kept aside and
along failures. Writes `table2.md`, `table2.csv` (a line an encoder) and `table2.png`. A run that is
cut off goes on where it stood.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import demonstrations, learners, setup
from gril_jax.experiments.sweeps import rewards as sweep_rewards
from gril_jax.experiments.sweeps.named_rows import Rows, changed
from gril_jax.experiments.sweeps.rewards import LearnedReward, reward_key
from gril_jax.experiments.sweeps.rows import Row

from gril_jax import reward
from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.config.grid import with_seed
from gril_jax.demos.schema import DemoEntry
from gril_jax.errors import ConfigError, DemoError
from gril_jax.report.figures.spread import spread
from gril_jax.report.figures.style import png
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress

from . import table as table2_table
from .measures import measure, stages_done
from .rows import ROWS, Settings, write_settings

__all__ = ["main", "usable"]

_LEAST = 2  # recordings of either outcome


def main(
    config: RunConfig,
    settings: Settings,
    *,
    resume: Path | None = None,
    echo: Callable[[str], None] = print,
) -> Path:
    """Run it, or go on with the run in a folder; returns the run's folder.

    Args:
      config: what all rows have in common; each changes fields of it.
      settings: the rows, and how many seeds.
      resume: folder of a run with this configuration and these settings.
      echo: takes what is said on the way.

    Raises:
      ConfigError: a row's value is out of range.
      DemoError: the demonstrations do not serve, or there are too few failures.
      RunError: the run cannot be made, or cannot go on.
    """
    rows = [
        Row(cell, seed, with_seed(changed(config, change), seed))
        for cell, change in enumerate(settings.rows.values())
        for seed in range(settings.seeds)
    ]
    env = setup.make_env(config.env, training=False)
    opened = {"device": setup.device_in_words(), "experiment": "table2"}
    with run_dir.create_or_resume(config, resume, **opened) as run, Progress() as progress:
        if resume is None:
            write_settings(run.path, settings)
        echo(f"writing to {run.path}: {len(rows)} encoders")
        demos = demonstrations.gather_once(config, env, run, progress)
        _check(demos.demo_set.folder, demos.names)
        with ahead.compiling() as pool:
            wanted = sweep_rewards.get_ready(rows, lambda config: demos, pool)
            rewards = sweep_rewards.learn_rewards(wanted, run, progress, echo)
        phase = progress.phase("measuring", total=len(settings.rows), unit="rows")
        lines: list[dict[str, Any]] = []
        for cell, name in enumerate(settings.rows):
            members = [row for row in rows if row.cell == cell]
            found = [rewards[reward_key(row.config)] for row in members]
            if run.finished_phase(f"measures-{cell}") is None:
                values = _measured(members, found, demos)
                run.finish_phase(f"measures-{cell}", {"seeds": values})
            done = run.finished_phase(f"measures-{cell}") or {}
            for row, one, values in zip(members, found, done["seeds"], strict=True):
                lines.append({"row": name, "seed": row.seed, "tau": one.tau} | values)
            table = _write(run.path, lines)
            phase.update(cell + 1)
        table = _write(run.path, [*lines, *_of_true_stages(demos)])
        run.finish({"encoders": len(rows)})
    echo(table)
    echo(f"written to {run.path}")
    return run.path


def usable(config: RunConfig, echo: Callable[[str], None] = print) -> Rows:
    """The rows that this configuration can train; says of each other one why it is left out."""
    rows = {}
    for name, change in ROWS.items():
        try:
            changed(config, change)
        except ConfigError as error:
            echo(f"without the row {name!r}: {error}")
        else:
            rows[name] = change
    return rows


def _check(folder: Path, names: Mapping[str, Sequence[str]]) -> None:
    for split, what in (("failure", "failures"), ("validation", "successes kept aside")):
        count = len(names[split])
        if count < _LEAST:
            raise DemoError(
                f"{folder} has {count} {what}, but rho needs at least {_LEAST}: "
                f"make more with demos.num_{'failures' if split == 'failure' else 'validation'}"
            )


def _recordings(demos: demonstrations.Demonstrations) -> list[DemoEntry]:
    """Successes kept aside, then failures."""
    entries = {entry.name: entry for entry in demos.demo_set.entries}
    return [entries[name] for split in ("validation", "failure") for name in demos.names[split]]


def _of_true_stages(demos: demonstrations.Demonstrations) -> list[dict[str, Any]]:
    """A line of the reward that the true stages give: how far any staircase could get."""
    chosen = _recordings(demos)
    if not all(entry.stages for entry in chosen):
        return []
    length = np.array([entry.frames for entry in chosen], np.int32)
    left = [1 - stages_done(e, int(length.max())) / len(e.stages or "-") for e in chosen]
    values = measure(-np.stack(left).astype(np.float32), length, chosen)
    return [{"row": "true stages, -(1 - done / all)", "seed": 0} | values]


def _measured(
    rows: Sequence[Row], found: Sequence[LearnedReward], demos: demonstrations.Demonstrations
) -> list[dict[str, float]]:
    """`measure` of each seed's reward."""
    chosen = _recordings(demos)
    length = np.array([entry.frames for entry in chosen], np.int32)
    learner, hyper = learners.learner(rows[0].config, demos), setup.pretrain_hyper(rows[0].config)
    films = learner.films([entry.name for entry in chosen])

    def one(params):
        latents = learner.latents(params.encoder, films, hyper)
        return np.asarray(reward.latent_reward(params, jnp.asarray(latents)))

    return [measure(one(each.params), length, chosen) for each in found]


def _write(folder: Path, lines: Sequence[table2_table.Line]) -> str:
    """Tables and figure of the rows so far; returns the table."""
    table = table2_table.markdown(lines)
    names = list(dict.fromkeys(line["row"] for line in lines))
    ratios = {
        name: np.array([line["rho_held"] for line in lines if line["row"] == name], float)
        for name in names
    }
    figure = spread(ratios, "rho of held-out recordings, held to one length; lower is better")
    with run_dir.writing(folder):
        (folder / "table2.md").write_text(table + "\n", encoding="utf-8")
        (folder / "table2.csv").write_text(table2_table.csv(lines), encoding="utf-8")
        (folder / "table2.png").write_bytes(png(figure))
    return table
