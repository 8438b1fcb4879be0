"""The rows of Table III: rewards, each on every long task at the table."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.workflows.study.rows import GRAPHIRL, PAPERS_OWN, Settings, changed

from ..table1.rows import with_steps as with_steps

TASKS = (
    "rubbish_in_bin", "umbrella_out", "item_in_drawer", "shoes_in_box", "shoes_out_of_box",
    "empty_container",
)  # fmt: skip

# Every learned row says all that any of them changes, so that defaults may move without moving the
# table; what trains policies is the configuration's in all of them.
_PAPER: dict[str, Any] = PAPERS_OWN | {
    "env.reward": "staged",
    "run.reward": "learned",
    "run.reward_offset": 1.0,
    "encoder.latent": 32,
    "pool.alpha": 5.0,
    "loss.warmup": 0,
    "loss.near_cost_fraction": 1.0,  # these four act on copies alone
    "loss.trim_quantile": 0.02,
    "loss.clearance_radius": 2.0,
    "loss.intrusion_weight": 1.0,
    "pretrain.steps": 6000,
}
_OWN = {"run.reward": "environmental", "run.reward_offset": 0.0}
# XIRL sees pictures, of which these tasks have none inside compiled programs; what stands for it is
# what made its reward work in Table I, times agreed on, with boxes in the place of pictures.
_TIMES = {"encoder.kind": "mlp", "loss.lambda_": 0.0, "loss.decoder": "graph", "loss.warmup": 1500}
REWARDS: dict[str, dict[str, Any]] = {
    "the task's own": _OWN | {"env.reward": "staged"},
    "sparse success": _OWN | {"env.reward": "sparse"},
    "XIRL on boxes with agreed times": _PAPER | _TIMES,
    "GraphIRL": _PAPER | GRAPHIRL,
    "the paper's form": _PAPER,
    "ours": _PAPER
    | {
        "encoder.latent": 1,
        "encoder.relations": True,
        "pool.alpha": 1.0,
        "loss.warmup": 1500,
        "pretrain.num_perturbations": 4,
        "pretrain.adversarial_steps": 2,
    },
}
_BETWEEN = " on "

ROWS = {
    f"{reward}{_BETWEEN}{task}": change | {"env.name": task}
    for reward, change in REWARDS.items()
    for task in TASKS
}


def parts(row: str) -> tuple[str, str]:
    """The reward and the task of a row."""
    reward, _, task = row.rpartition(_BETWEEN)
    return reward, task


def paths() -> set[str]:
    """The fields that rows set, which cannot be chosen for all of them."""
    return {path for change in ROWS.values() for path in change}


def configs(config: RunConfig, settings: Settings) -> Sequence[RunConfig]:
    """A row's configuration each; of a folder with a set for each task, the row's own set."""
    return [_with_set(changed(config, change)) for change in settings.rows.values()]


def with_sets(config: RunConfig, folder: str | None) -> RunConfig:
    """The configuration with a folder that has a set for each task, or none."""
    return dataclasses.replace(config, demos=dataclasses.replace(config.demos, path=folder))


def _with_set(config: RunConfig) -> RunConfig:
    path = config.demos.path
    return config if path is None else with_sets(config, str(Path(path) / config.env.name))


def check(config: RunConfig, rows: Any) -> None:
    """Refuses, before work starts, a learner that rows are not for, and sets that are missing."""
    if config.run.algorithm != "ppo":
        raise ConfigError(f"run.algorithm is {config.run.algorithm!r}, but must be 'ppo' here")
    if config.demos.path is None:
        return
    for task in dict.fromkeys(parts(row)[1] for row in rows):
        if not (Path(config.demos.path) / task / "demos.json").is_file():
            raise ConfigError(
                f"{config.demos.path} has no set {task}, but must hold one for each task, as "
                "`gril demos make tabletop --env.name TASK --out FOLDER/TASK` makes them"
            )
