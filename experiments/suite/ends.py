"""Rewards of one task whose ends are described in several ways, as JSON.

    python -m gril_jax.experiments.suite.ends --sets SETS --task make_line --out make_line.json

Each row changes what counts as done in copies of frames, and whether the goal is the mean of the
last frames' latents or a set of them; all else is the configuration `magical_suite`.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import tyro
from gril_jax.experiments.pipeline import demonstrations, learners, setup

from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.config.files import load
from gril_jax.safe_files import write_whole

from ..fidelity.physics_parity import printed
from ..tables.measures import audit_figures, audit_program, ground
from ..tables.rewards import stack
from ..tables.rows import changed
from .rows import ROWS as TASK_ROWS
from .rows import row_name

ROWS: dict[str, dict[str, Any]] = {
    "arrangement, set of goals": {"loss.ends": "arrangement", "loss.goals": 14},
    "arrangement, mean goal": {"loss.ends": "arrangement", "loss.goals": 1},
    "places, set of goals": {"loss.ends": "places", "loss.goals": 14},
    "places, mean goal, turned scenes": {
        "loss.ends": "places", "loss.goals": 1, "pretrain.turn_scenes": True,
    },
    "arrangement, set of goals, turned scenes": {
        "loss.ends": "arrangement", "loss.goals": 14, "pretrain.turn_scenes": True,
    },
    "no copies, mean goal": {"loss.goals": 1, "pretrain.copies": 0},
}  # fmt: skip


@dataclass(frozen=True)
class _Options:
    sets: Path
    """Folder of the tasks' demonstration sets."""
    task: str
    """The task."""
    out: Path
    """JSON file of the results, written after each row."""
    rows: tuple[str, ...] = tuple(ROWS)
    """Ways to describe ends."""
    seeds: int = 1
    """Encoders of each row."""
    steps: int = 2500
    """Gradient steps."""
    width: int = 32
    """Width of the encoder."""
    ascents: int = 200
    """Gradient ascents of the audit."""
    starts: int = 2
    """Starts of the audit."""


def measure(config: RunConfig, seeds: int, *, ascents: int, starts: int) -> dict[str, Any]:
    """Tau on films kept aside, and the audit from Demo, of some seeds of one row."""
    env = setup.make_env(config.env, training=False)
    demos = demonstrations.chosen(config, env, Path(config.demos.path))
    learner, hyper = learners.learner(config, demos), setup.pretrain_hyper(config)
    states = {"demo": setup.make_env(config.env, training=False, variant="demo")}
    on = ground(states, starts=starts)
    encoder = setup.encoder_config(config, len(env.classes))
    audited = audit_program(encoder, on.task, ascents=ascents)
    step, found = None, []
    for seed in range(seeds):
        key = jax.random.fold_in(jax.random.key(seed), 0)
        state = jax.jit(learner.init)(key, learner.data)
        if step is None:
            lowered = jax.jit(learner.step, donate_argnums=0).lower(state, learner.data, hyper)
            step = compiled(lowered, brief=True)
        for _ in range(config.pretrain.steps // learner.static.updates):
            state, _ = step(state, learner.data, hyper)
        figures = jax.jit(learner.measure)(state, learner.data, hyper)
        params = jax.jit(learner.reward)(state, learner.data, hyper)
        audit = audit_figures(audited, stack([params]), on)
        one = {name: float(value) for name, value in figures.items()}
        found.append(one | {name: float(value[0]) for name, value in audit.items()})
    return {name: [one[name] for one in found] for name in found[0]}


def main(argv: list[str] | None = None) -> int:
    """Writes the results after each row, and prints them."""
    options = tyro.cli(_Options, args=argv)

    def work() -> dict:
        common = TASK_ROWS[row_name(options.task, "films")] | {
            "demos.path": str(options.sets / options.task), "ppo.num_timesteps": 1_000_000,
            "encoder.width": options.width, "encoder.latent": options.width // 2,
            "pretrain.steps": options.steps,
        }  # fmt: skip
        found = {}
        for name in options.rows:
            config = changed(load("magical_suite", []), common | ROWS[name])
            budget = {"ascents": options.ascents, "starts": options.starts}
            found[name] = measure(config, options.seeds, **budget)
            write_whole(options.out, json.dumps(found, indent=1) + "\n")
        return found

    return printed("ends", work)


if __name__ == "__main__":
    sys.exit(main())
