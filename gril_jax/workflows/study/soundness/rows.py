"""The rows of an ablation of soundness: each is a way of training encoders."""

from dataclasses import dataclass
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.workflows.study.rows import AuditedSettings, changed, require_learned

# Every row says all that any row changes, so that defaults may move without moving the table.
_PAPER: dict[str, Any] = {
    "encoder.relations": False,
    "encoder.width": 64,
    "encoder.ensemble_size": 1,
    "pool.alpha": 5.0,
    "pretrain.turn_scenes": False,
    "pretrain.random_activity": 0.0,
    "pretrain.num_perturbations": 0,
    "pretrain.adversarial_steps": 0,
    "loss.warmup": 0,
    "loss.perturbation_weight": 30.0,  # these act on copies alone
    "loss.near_cost_fraction": 0.8,
    "loss.touch": 0.0,
    "loss.goal_model": "places",
    "loss.quartic_weight": 1.0,
}
_TURNED = {"pretrain.turn_scenes": True}
_TOUCHED = {"pretrain.random_activity": 0.1}
_AGREED = {"loss.warmup": 1500}
_RELATIONS = {"encoder.relations": True}
_MEMBERS = {"encoder.ensemble_size": 4}
_COPIES = {"pretrain.num_perturbations": 4}
_VARIED = _PAPER | _TURNED | _TOUCHED | _AGREED
_ALL = _VARIED | _COPIES | _RELATIONS | {"pretrain.adversarial_steps": 2}

ROWS: dict[str, dict[str, Any]] = {
    "paper": _PAPER,
    "paper with 4 members": _PAPER | _MEMBERS,
    "turned scenes": _PAPER | _TURNED,
    "touched": _PAPER | _TOUCHED,
    "agreed times": _PAPER | _AGREED,
    "relations": _PAPER | _RELATIONS,
    "copies": _PAPER | _COPIES,
    "turned + touched + agreed": _VARIED,
    "turned + touched + agreed + copies": _VARIED | _COPIES,
    "all but ascents": _ALL | {"pretrain.adversarial_steps": 0},
    "all": _ALL,
    "all but relations": _ALL | {"encoder.relations": False},
    "all with alpha 1": _ALL | {"pool.alpha": 1.0},
    "all with alpha 2": _ALL | {"pool.alpha": 2.0},
    "all with near 0.5": _ALL | {"loss.near_cost_fraction": 0.5},
    "all with near 0.5 + touch 0.05": _ALL | {"loss.near_cost_fraction": 0.5, "loss.touch": 0.05},
    "all with tail 0": _ALL | {"loss.quartic_weight": 0.0},
    "all with 4 members": _ALL | _MEMBERS,
    "all with width 128": _ALL | {"encoder.width": 128},
    "all with width 128 + alpha 2": _ALL | {"encoder.width": 128, "pool.alpha": 2.0},
}


@dataclass(frozen=True)
class Settings(AuditedSettings):
    """All of an ablation of soundness that is not in the configuration."""

    policies: bool = True
    """True if a policy is trained with each encoder's reward."""
    policies_at_once: int = 25
    """Largest number of policies in one program."""


def with_budget(config: RunConfig, steps: int | None) -> RunConfig:
    """The configuration with this many control steps for a policy; unchanged for None or 0.

    Raises ConfigError, too, if policies would not learn from the rewards.
    """
    require_learned(config)
    if not steps:
        return config
    return changed(config, {f"{config.run.algorithm}.num_timesteps": steps})
