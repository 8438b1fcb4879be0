"""The rows of a ladder: rewards, each at every level of help that a learner can be given."""

from typing import Any

from gril_jax.envs import registry

from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError

from ..table1.rows import ROWS as TABLE1
from ..table1.rows import with_steps as with_steps
from ..tables.rows import Settings as Settings

_OWN_STARTS: dict[str, Any] = {
    "env.variant": "jitter",
    "env.varied_starts": 0.0,
    "env.on_the_way": 0.0,
    "env.facing": 0.0,
    "env.observation": "plain",
    "ppo.own_starts": 0.0,
    "ppo.video_starts": 0.0,
}
# As `experiments.pipeline.given` defines them, the least help first.
LEVELS: dict[str, dict[str, Any]] = {
    "A": _OWN_STARTS,
    "B": _OWN_STARTS | {"ppo.own_starts": 0.7},
    "V": _OWN_STARTS | {"ppo.video_starts": 0.7},
    "C": _OWN_STARTS
    | {
        "env.varied_starts": 0.8,
        "env.on_the_way": 0.5,
        "env.facing": 0.5,
        "env.observation": "sorted",
    },
}
REWARDS: dict[str, dict[str, Any]] = {
    "S4 of the task": TABLE1["environmental"],
    "sparse score of the task": TABLE1["sparse score"],
    "XIRL with agreed times": TABLE1["XIRL with agreed times"],
    "GraphIRL": TABLE1["GraphIRL without robot"],
    "the paper's form": TABLE1["ours without robot"],
    "ours": TABLE1["ours audited and denser"],
    "ours with sub-policies": TABLE1["ours audited and denser"]
    | {"run.reward": "stages", "ppo.sub_policies": 2},
}
_BETWEEN = " at level "

ROWS = {
    f"{reward}{_BETWEEN}{level}": change | help_
    for reward, change in REWARDS.items()
    for level, help_ in LEVELS.items()
}


def parts(row: str) -> tuple[str, str]:
    """The reward and the level of a row."""
    reward, _, level = row.rpartition(_BETWEEN)
    return reward, level


def paths() -> set[str]:
    """The fields that rows set, which cannot be chosen for all of them."""
    return {path for change in ROWS.values() for path in change}


def check(config: RunConfig) -> None:
    """Refuses, before work starts, a task or a learner that the rows are not for."""
    task, learner = config.env.name, config.run.algorithm
    if not {"S4", "sparse"} <= {*registry.spec(task).rewards}:
        raise ConfigError(
            f"env.name is {task!r}, but a ladder is made for match_regions, whose rewards and "
            "starts its rows name"
        )
    if learner != "ppo":
        raise ConfigError(f"run.algorithm is {learner!r}, but must be 'ppo' for a ladder")
