"""Trains a policy on a reward that has been learned before: `gril train --reward FILE|RUN`."""

import dataclasses
from pathlib import Path

from gril_jax.config import RunConfig
from gril_jax.config.tables import ENCODERS, find
from gril_jax.encoders.ensemble import num_members
from gril_jax.envs import Env
from gril_jax.errors import ConfigError
from gril_jax.export.reward_file import load_reward
from gril_jax.graphs.activity_rule import PAPER
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.workflows import export_reward
from gril_jax.workflows.audit import require_one_unit
from gril_jax.workflows.build import setup


def load(source: Path) -> LearnedReward:
    """The reward in a file of `LearnedReward.save`, or of a run's folder.

    Raises:
      RewardFileError: there is no such file, or it is damaged.
      RunError: the folder is no run, or has no reward yet.
    """
    return export_reward.of_run(source) if source.is_dir() else load_reward(source)


def configured(config: RunConfig, learned: LearnedReward, env: Env, source: str) -> RunConfig:
    """The configuration with the encoder, activity rule and number of goals of a reward.

    Args:
      config: of the run that will use it; `env` is its task.
      learned: the reward; `source` names it in errors.

    Raises:
      ConfigError: the reward was learned for other classes or another unit than the task's, or has
        an encoder or an activity rule that no configuration has.
    """
    if tuple(learned.classes) != tuple(env.classes):
        raise ConfigError(
            f"{source} was learned for the classes {', '.join(learned.classes)}, but "
            f"{config.env.shown_name} has {', '.join(env.classes)}: both must have the same words "
            "in the same order"
        )
    require_one_unit(learned, config.env.name, env, source)
    return with_choices(config, learned, source)


def with_choices(config: RunConfig, learned: LearnedReward, source: str) -> RunConfig:
    """The configuration with a reward's choices, whatever the task; errors as `configured`."""
    goal = learned.params.goal
    goals = goal.shape[0] if goal.ndim == 2 and num_members(learned.config) == 1 else 1
    found = dataclasses.replace(
        config,
        encoder=_encoder(config, learned),
        pool=_with(config.pool, learned.activity._asdict()),
        loss=dataclasses.replace(config.loss, goals=goals),
    )
    same = setup.encoder_config(found, len(learned.classes)) == learned.config
    rule = PAPER._replace(**found.pool.rule())
    if not same or rule != learned.activity:
        raise ConfigError(
            f"{source} has an encoder or an activity rule that no configuration has, so no policy "
            "can be trained on it here; in code of one's own it works as it is"
        )
    return found


def _encoder(config: RunConfig, learned: LearnedReward):
    """The section `encoder` that makes the reward's encoder."""
    kind = next(n for n, one in ENCODERS.items() if isinstance(learned.config, find(one.config)))
    own = {field.name: getattr(learned.config, field.name) for field in _fields(learned.config)}
    words = getattr(learned.config, "words", None)
    robot = getattr(learned.config, "pool_robot", False)
    chosen = {"kind": kind, "share_attributes": bool(words), "robot": robot}
    return _with(config.encoder, own | chosen)


def _with(section, values: dict):
    """A section with those of the values that it has fields for."""
    known = {field.name for field in _fields(section)}
    return dataclasses.replace(section, **{n: x for n, x in values.items() if n in known})


def _fields(value):
    return dataclasses.fields(value)
