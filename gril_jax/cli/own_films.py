"""Settings of a run that the demonstration set of somebody's own films decides.

A set without a task has its own classes, unit and frame rate. The run's configuration then takes
from the set what depends on them, unless the command line says otherwise.
"""

import math
from pathlib import Path
from typing import Any

from gril_jax.config.files import load
from gril_jax.config.task import NO_TASK
from gril_jax.envs import registry
from gril_jax.errors import DemoError, RunError
from gril_jax.safe_files import read_object

CONFIG = "own_videos"
_TOGETHER = 4  # films of a batch, at most
_WINDOW = 4.0  # seconds that a displacement is measured over


def configured(name: str | None, args: list[str]) -> tuple[str | None, list[str]]:
    """The configuration's name, and the arguments with what the set of films adds before them.

    Where neither a configuration is named nor the set's task is known, the configuration is
    `own_videos`. A set that cannot be read is left to who looks at it later.
    """
    header = _header(args)
    if header is None or (name is None and header.get("task") in registry.names()):
        return name, args
    name = name or CONFIG
    if load(name).env.name != NO_TASK:
        return name, args
    return name, [*_of_set(header), *args]


def with_noise(name: str | None, args: list[str]) -> list[str]:
    """The arguments of a run, and before them how much the set's boxes jitter, unless the
    configuration says it: else any jitter would count as motion."""
    header = _header(args)
    if header is None or not isinstance(header.get("noise"), float):
        return args
    if name is not None and load(name).pool.noise is not None:
        return args
    return [*_options({"--pool.noise": header["noise"]}), *args]


def _header(args: list[str]) -> dict[str, Any] | None:
    """The header of the set that the arguments name."""
    folder = None
    for index, arg in enumerate(args):
        option, equals, value = arg.partition("=")
        if option in ("--demos", "--demos.path"):
            folder = value if equals else next(iter(args[index + 1 :]), None)
    try:
        return None if folder is None else read_object(Path(folder) / "demos.json")
    except RunError as error:
        raise DemoError(str(error)) from None
    except OSError:
        return None


def _of_set(header: dict[str, Any]) -> list[str]:
    """Options that depend on a set's units, if it has them."""
    fields = {"--encoder.length-unit": header.get("half_extent")}
    if isinstance(rate := header.get("fps"), int | float) and 0 < rate < 1e6:
        fields["--pool.window"] = max(1, round(_WINDOW * rate))
    demos = [one for one in header.get("demos", ()) if isinstance(one, dict)]
    good = [one for one in demos if one.get("outcome") != "failure"]
    fields["--pretrain.num-videos"] = max(2, min(_TOGETHER, len(good) - math.ceil(len(good) / 4)))
    return _options(fields)


def _options(fields: dict[str, Any]) -> list[str]:
    return [f"{option}={value}" for option, value in fields.items() if value is not None]
