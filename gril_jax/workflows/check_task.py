"""Checks a task of one's own against the contract: `gril check-task my_task.py:make`."""

from collections.abc import Callable, Mapping
from typing import Any

from gril_jax.envs import registry
from gril_jax.envs.user_tasks import episodes
from gril_jax.errors import ConfigError


def main(name: str, options: Mapping[str, Any], *, echo: Callable[[str], None] = print) -> int:
    """Says what holds and what does not, a line each; returns 1 if something needed is missing.

    Raises ConfigError if the task cannot be made or is not of the form that everything needs.
    """
    try:
        env = registry.build(name, options)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    echo(
        f"{registry.shown_name(name)}: classes {', '.join(env.classes)}; {env.action_size} "
        f"actions, {env.observation_size} observations, at most {env.episode_length} steps"
    )
    missing = 0
    for found in episodes.findings(env):
        verdict = "ok" if found.holds else "MISSING" if found.needed else "look"
        missing += not found.holds and found.needed
        echo(f"{found.name:<16}  {verdict:<8}  {found.said}")
    absent = [name for name in ("expert", "stages", "place") if getattr(env, name) is None]
    uses = {
        "expert": "gril demos make has nobody to video",
        "stages": "gril audit cannot tell progress",
        "place": "states cannot be made from boxes",
    }
    for name in absent:
        echo(f"{name:<16}  none      optional: without it {uses[name]}")
    return int(missing > 0)
