"""The rows of Table I: the fields that each changes, and the success that the paper reports."""

import json
import math
from pathlib import Path
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.envs import registry
from gril_jax.errors import ConfigError, DemoError
from gril_jax.workflows.study.rows import (
    GRAPHIRL,
    PAPERS_OWN,
    WITH_ROBOT,
    XIRL,
    AuditedSettings,
    Rows,
)

# Every learned row says all that any of them changes, so that defaults may move without moving the
# table. What trains policies, `ppo` or `sac`, and the task are the configuration's in all of them.
_PAPER: dict[str, Any] = PAPERS_OWN | {
    "env.reward": "S4",
    "run.reward": "learned",
    "run.reward_offset": 0.0,
    "loss.warmup": 0,
    "loss.contrast": 30.0,  # these act on copies alone
    "loss.near": 0.8,
    "loss.touch": 0.0,
    "loss.anywhere_inside": False,
    "pretrain.steps": 2500,
    "pretrain.learning_rate_left": 1.0,
}
_XIRL = _PAPER | XIRL | {"encoder.pixels": 64, "encoder.precision": "bfloat16"}
_AUDITED = _PAPER | {
    "encoder.relations": True,
    "loss.warmup": 1500,
    "pretrain.steps": 8000,
    "pretrain.learning_rate_left": 0.0,
    "pretrain.turn_scenes": True,
    "pretrain.touched": 0.1,
    "pretrain.copies": 4,
    "pretrain.ascents": 2,
}
# Something for a touch and for the way, as much for any success, and 0 where nothing has been done:
# what leads a policy that has to find the blocks by itself.
_DENSER = _AUDITED | {
    "loss.near": 0.7,
    "loss.touch": 0.05,
    "loss.anywhere_inside": True,
    "pretrain.steps": 16000,
    "pretrain.ascents": 4,
    "run.reward_offset": 1.0,
}
# The potential's part of a whole episode is as much as ten control steps with full score.
_SHAPED = {"env.reward": "sparse", "run.reward": "shaped"}


ROWS: dict[str, dict[str, Any]] = {
    "environmental": {"env.reward": "S4", "run.reward": "environmental"},
    "environmental V5": {"env.reward": "V5", "run.reward": "environmental"},
    "XIRL": _XIRL,
    "XIRL with agreed times": _XIRL | {"loss.warmup": 1500},
    "GraphIRL with robot": _PAPER | GRAPHIRL | WITH_ROBOT,
    "GraphIRL without robot": _PAPER | GRAPHIRL,
    "ours with robot": _PAPER | WITH_ROBOT,
    "ours without robot": _PAPER,
    "ours audited": _AUDITED,
    "ours audited and denser": _DENSER,
    "ours with soft-DTW": _AUDITED | {"loss.consistency": "soft_dtw"},
    "ours with potential shaping": _AUDITED | _SHAPED,
    "sparse score": {"env.reward": "sparse", "run.reward": "environmental"},
}

# Success that the paper's Table I reports, percent.
PAPER = {
    "environmental": 85.0,
    "XIRL": 0.0,
    "GraphIRL with robot": 0.0,
    "GraphIRL without robot": 33.7,
    "ours with robot": 33.3,
    "ours without robot": 94.6,
}

EVALUATIONS = 10  # of each policy while it is trained

# A setting that two CPU cores finish in minutes.
QUICK = "environmental,ours without robot"
QUICK_SEEDS = 2
QUICK_STEPS = 1500  # of each encoder

Settings = AuditedSettings


def with_steps(rows: Rows, steps: int | None) -> Rows:
    """The rows with so many gradient steps of every encoder; of its row's own where None."""
    if steps is None:
        return rows
    return {
        name: change | ({"pretrain.steps": steps} if "pretrain.steps" in change else {})
        for name, change in rows.items()
    }


def paths(rows: Rows) -> set[str]:
    """The fields that rows set, which cannot be chosen for all of them."""
    return {path for change in rows.values() for path in change}


def check(config: RunConfig) -> None:
    """Refuses a task or demonstrations that the rows cannot use, before work starts."""
    needed = dict.fromkeys(row["env.reward"] for row in ROWS.values())
    if not {*needed} <= {*registry.spec(config.env.name).rewards}:
        raise ConfigError(
            f"env.name is {config.env.name!r}, but must be a task with the rewards "
            f"{', '.join(needed)}, which the rows set"
        )
    if config.demos.path is None:
        return
    header = Path(config.demos.path) / "demos.json"
    try:
        about = json.loads(header.read_text(encoding="utf-8"))
        task, outcomes = about["task"], [demo["outcome"] for demo in about["demos"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise DemoError(f"{header} is damaged, but must describe demonstrations") from None
    if task != config.env.name:
        raise DemoError(
            f"{config.demos.path} holds demonstrations of {task!r}, but must hold some of "
            f"{config.env.name!r}"
        )
    good = len(outcomes) - outcomes.count("failure")  # counted as `demonstrations.gather` does
    held, needed = min(config.demos.num_validation, math.ceil(good / 4)), config.pretrain.num_videos
    if good - held < needed:
        raise DemoError(
            f"{config.demos.path} has {good - held} demonstrations to train on beside {held} kept "
            f"aside, but a batch needs {needed}: add some, or lower pretrain.num_videos"
        )
