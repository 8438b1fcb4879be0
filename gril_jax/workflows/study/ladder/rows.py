"""The rows of a ladder: rewards, each at every level of help that a learner can be given.

MatchRegions has its own; tasks on a table have those of Table III. Levels are as
`experiments.pipeline.given` defines them, the least help first.
"""

from collections.abc import Mapping
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.envs import registry
from gril_jax.errors import ConfigError
from gril_jax.workflows.study.rows import Rows
from gril_jax.workflows.study.rows import Settings as Settings

from ..table1.rows import ROWS as TABLE1
from ..table1.rows import with_steps as with_steps
from ..table3.rows import REWARDS as TABLE3

_OWN_STARTS: dict[str, Any] = {
    "env.varied_starts": 0.0,
    "env.observation": "plain",
    "ppo.own_starts": 0.0,
    "ppo.video_starts": 0.0,
    "ppo.held_noise": 0.0,
}
# What lies between moments has to be found: a policy that has nothing to gain walks at random, and
# gets further in one direction at a time.
_OWN_MOMENTS = _OWN_STARTS | {"ppo.own_starts": 0.7, "ppo.held_noise": 0.5}
_JITTER = {"env.variant": "jitter", "env.near_starts": 0.0}
_MATCH_REGIONS: dict[str, dict[str, Any]] = {
    "A": _JITTER | _OWN_STARTS,
    "B": _JITTER | _OWN_MOMENTS,
    "V": _JITTER | _OWN_STARTS | {"ppo.video_starts": 0.7},
    "C": _JITTER
    | _OWN_STARTS
    | {
        "env.varied_starts": 0.8,
        "env.near_starts": 0.5,
        "env.observation": "sorted",
    },
}
_TABLE: dict[str, dict[str, Any]] = {
    "A": _OWN_STARTS,
    "B": _OWN_MOMENTS,
    "V": _OWN_STARTS | {"ppo.video_starts": 0.7},
    "C": _OWN_STARTS | {"env.varied_starts": 0.7, "env.observation": "rich"},
}
_NOT_FROM_BOXES = ("item_in_drawer", "umbrella_out")  # tasks without a layout: no level V
LEVELS = (*_MATCH_REGIONS,)
_BETWEEN = " at level "


def _rows(rewards: Rows, levels: Rows) -> Rows:
    """A row for each of the rewards at each of the levels."""
    return {
        f"{reward}{_BETWEEN}{level}": dict(change) | dict(help_)
        for reward, change in rewards.items()
        for level, help_ in levels.items()
    }


def _in_stages(change: Mapping[str, Any], count: int) -> dict[str, Any]:
    """The same reward in its stages, with so many sub-policies."""
    return dict(change) | {"run.reward": "stages", "ppo.sub_policies": count}


ROWS = _rows(
    {
        "S4 of the task": TABLE1["environmental"],
        "sparse score of the task": TABLE1["sparse score"],
        "XIRL with agreed times": TABLE1["XIRL with agreed times"],
        "GraphIRL": TABLE1["GraphIRL without robot"],
        "the paper's form": TABLE1["ours without robot"],
        "ours": TABLE1["ours audited and denser"],
        "ours with sub-policies": _in_stages(TABLE1["ours audited and denser"], 2),
    },
    _MATCH_REGIONS,
)
TABLE_ROWS = _rows(TABLE3 | {"ours with sub-policies": _in_stages(TABLE3["ours"], 3)}, _TABLE)


def of_task(task: str) -> Rows:
    """The rows for a task; a ConfigError if there are none."""
    rewards = {*registry.spec(task).rewards}
    if {"S4", "sparse"} <= rewards:
        return ROWS
    if {"staged", "sparse"} <= rewards:
        left_out = "V" if task in _NOT_FROM_BOXES else ""
        return {row: change for row, change in TABLE_ROWS.items() if parts(row)[1] != left_out}
    raise ConfigError(
        f"env.name is {task!r}, but a ladder is made for match_regions and for tasks on a table, "
        "whose rewards and starts its rows name"
    )


def parts(row: str) -> tuple[str, str]:
    """The reward and the level of a row."""
    reward, _, level = row.rpartition(_BETWEEN)
    return reward, level


def paths(rows: Rows) -> set[str]:
    """The fields that rows set, which cannot be chosen for all of them."""
    return {path for change in rows.values() for path in change}


def check(config: RunConfig) -> None:
    """Refuses, before work starts, a learner that the rows are not for."""
    if config.run.algorithm != "ppo":
        raise ConfigError(
            f"run.algorithm is {config.run.algorithm!r}, but must be 'ppo' for a ladder"
        )
