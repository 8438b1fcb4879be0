"""The rows of Table II: the fields that each changes, and the ratio that the paper reports."""

from collections.abc import Callable
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.workflows.study.rows import GRAPHIRL, PAPERS_OWN, WITH_ROBOT, XIRL, Rows, changed

# Every row says all that any of them changes, so that defaults may move without moving the table.
_PAPER: dict[str, Any] = PAPERS_OWN | {
    "encoder.latent": 32,
    "pool.alpha": 5.0,
    "loss.near_cost_fraction": 0.5,
}
# Why a latent of one number and no weight for what has moved: see configs/shoes_in_box.yaml.
_OURS = _PAPER | {"encoder.latent": 1, "pool.alpha": 1.0}
# What makes the reward of MatchRegions pass its audit.
_AUDITED = _OURS | {
    "encoder.relations": True,
    "pretrain.num_perturbations": 4,
    "pretrain.adversarial_steps": 2,
}
# And what teaches policies, configs/shoes_in_box.yaml: nothing is paid for the way.
_FOR_POLICIES = _AUDITED | {"loss.near_cost_fraction": 1.0}

ROWS: dict[str, dict[str, Any]] = {
    "XIRL": _PAPER | XIRL,
    "GraphIRL with robot": _PAPER | GRAPHIRL | WITH_ROBOT,
    "GraphIRL without robot": _PAPER | GRAPHIRL,
    "paper's form with robot": _PAPER | WITH_ROBOT,
    "paper's form without robot": _PAPER,
    "ours with robot": _OURS | WITH_ROBOT,
    "ours without robot": _OURS,
    "ours audited": _AUDITED,
    "ours for policies": _FOR_POLICIES,
    "ours with soft-DTW": _OURS | {"loss.consistency": "both"},
}

# The separation ratio of the paper's Table II.
PAPER = {
    "XIRL": 0.713,
    "GraphIRL with robot": 0.844,
    "GraphIRL without robot": 1.098,
    "paper's form with robot": 0.673,
    "paper's form without robot": 0.684,
    "ours with robot": 0.673,
    "ours without robot": 0.684,
}

# As many gradient steps for each row as tell success from failure; a policy's reward takes more.
USUAL: dict[str, Any] = {"pretrain.steps": 1200}

# A setting that two CPU cores finish in minutes: fewer demonstrations to film, fewer seeds, and no
# encoder of pictures, which would take hours.
QUICK_ROWS = ",".join(name for name in ROWS if ROWS[name]["encoder.kind"] != "pixels")
QUICK = {"demos.num": 20, "demos.num_validation": 6, "demos.num_failures": 21} | USUAL
QUICK_SEEDS = 2


def usable(config: RunConfig, echo: Callable[[str], None] = print) -> Rows:
    """The rows that this configuration can train; prints why the others are left out."""
    rows = {}
    for name, change in ROWS.items():
        try:
            changed(config, change)
        except ConfigError as error:
            echo(f"without the row {name!r}: {error}")
        else:
            rows[name] = change
    return rows
