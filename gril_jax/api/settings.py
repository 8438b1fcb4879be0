"""Settings of a function: a preset, changed by keyword.

    reward = learn_reward(demos, preset="quickstart", pretrain={"steps": 2000})

A keyword is a section of the configuration, with the fields that it changes.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

from gril_jax.config import RunConfig
from gril_jax.config.command_line import nearest
from gril_jax.config.files import load
from gril_jax.demos.demo_set import DemoSet
from gril_jax.envs import registry
from gril_jax.errors import ConfigError
from gril_jax.workflows.build import vocabulary

from . import inputs

Sections = Mapping[str, Any]  # by name, each a mapping of the fields that it changes


def for_demos(
    demos: DemoSet, preset: str | None, task: Any, sections: Sections, seed: int
) -> RunConfig:
    """The configuration of a reward that is learned from some demonstrations.

    Without a preset it is that of the task; of videos without a task it is `own_videos`. What a set
    decides, such as the unit of its lengths, the keywords may change.
    """
    if task is None and preset is None and demos.task in registry.names():
        task = demos.task
    config = load(preset or (vocabulary.PRESET if task is None else inputs.preset(task)))
    if task is not None:
        config = dataclasses.replace(config, env=inputs.env_config(task, config.env))
    return changed(vocabulary.fitted_to_set(config, demos), sections, seed)


def for_task(
    task: Any, preset: str | None, sections: Sections, seed: int, demos: DemoSet | None
) -> RunConfig:
    """The configuration of a policy for a task."""
    config = load(preset or inputs.preset(task))
    config = dataclasses.replace(config, env=inputs.env_config(task, config.env))
    if demos is not None:
        config = vocabulary.fitted_to_set(config, demos)
    return changed(config, sections, seed)


def changed(config: RunConfig, sections: Sections, seed: int) -> RunConfig:
    """The configuration with some fields of its sections, and its seed, set to other values.

    Raises:
      ConfigError: there is no such section or field, or a value is out of range.
    """
    parts = {name: getattr(config, name) for name in vars(config)}
    for name, values in sections.items():
        if name not in parts:
            raise ConfigError(
                f"there is no option {name!r}{nearest(name, [*parts])}: the sections are "
                f"{', '.join(parts)}, each a dictionary of its fields"
            )
        if not isinstance(values, Mapping):
            raise ConfigError(f"{name} is {values!r}, but must be a dictionary of its fields")
        known = [field.name for field in dataclasses.fields(parts[name])]
        for field in values:
            if field not in known:
                raise ConfigError(
                    f"{name} has no field {field!r}{nearest(field, known)}: they are "
                    f"{', '.join(known)}"
                )
        parts[name] = dataclasses.replace(parts[name], **values)
    parts["run"] = dataclasses.replace(parts["run"], seed=seed)
    return dataclasses.replace(config, **parts)
