"""The grid of a sweep: every combination of the given values, each with the same seeds.

    gril sweep quickstart --seeds 8 --reward learned,environmental --lambda 0.1,1

An option of the configuration whose value has commas is an axis; every other changes all runs.
"""

import dataclasses
import itertools
from collections.abc import Mapping

from gril_jax.config.command_line import options
from gril_jax.config.run_config import RunConfig
from gril_jax.errors import ConfigError

Axes = Mapping[str, tuple[str, ...]]  # options in full, such as --ppo.discounting, to values


def take_axes(args: list[str]) -> Axes:
    """Removes the options with commas in their values and returns them, in order; a ConfigError
    if one is given twice, or one of its values is empty or given twice."""
    known = options(RunConfig)
    full = {one.path: word for word, one in known.items() if "." in word}
    axes: dict[str, tuple[str, ...]] = {}
    rest: list[str] = []
    pending = iter([*args])
    for arg in pending:
        word, equals, value = arg.partition("=")
        option = known.get(word.replace("_", "-"))
        if option is None:
            rest.append(arg)
            continue
        if not equals:
            value = next(pending, "")
        if "," in value:
            name = full[option.path]
            if name in axes:
                raise ConfigError(f"{name} is given twice, but is one axis of the sweep")
            axes[name] = _values(name, value)
        else:
            rest += [arg] if equals or not value else [arg, value]
    args[:] = rest
    return axes


def _values(option: str, value: str) -> tuple[str, ...]:
    values = tuple(part.strip() for part in value.split(","))
    if "" in values:
        raise ConfigError(f"{option} is {value!r}, but must have a value between all commas")
    if twice := [part for part in values if values.count(part) > 1]:
        raise ConfigError(f"{option} is {value!r}, but must name {twice[0]} once")
    if option == "--run.seed":
        raise ConfigError("--run.seed cannot be an axis: --seeds N takes N seeds from it on")
    return values


def cells(axes: Axes) -> dict[str, list[str]]:
    """The options of every combination by its name, such as "lambda 0.1, reward learned"; the last
    axis changes fastest. Without axes that is "as configured"."""
    found = {}
    for values in itertools.product(*axes.values()):
        pairs = [*zip(axes, values, strict=True)]
        name = ", ".join(f"{option.rpartition('.')[2]} {value}" for option, value in pairs)
        found[name or "as configured"] = [*itertools.chain.from_iterable(pairs)]
    return found


def with_seed(config: RunConfig, offset: int) -> RunConfig:
    """The configuration with its seed increased by `offset`."""
    run = dataclasses.replace(config.run, seed=config.run.seed + offset)
    return dataclasses.replace(config, run=run)
