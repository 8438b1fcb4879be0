"""The grid of a sweep: every combination of the given values, each with the same seeds.

    gril sweep quickstart --seeds 8 --reward learned,environmental --lambda 0.1,1

An option whose value has commas is an axis of the sweep; every other option changes all runs.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

from gril_jax.config.run_config import RunConfig
from gril_jax.errors import ConfigError


class Axis(NamedTuple):
    """An option and its values."""

    option: str  # in full, such as --ppo.discounting
    values: tuple[str, ...]


class Cell(NamedTuple):
    """One combination: its labels, and its configuration with the first seed."""

    labels: tuple[tuple[str, str], ...]  # option without dashes, value
    config: RunConfig

    @property
    def name(self) -> str:
        """Its labels as "option value" pairs, or "as configured"."""
        words = (f"{option.rpartition('.')[2]} {value}" for option, value in self.labels)
        return ", ".join(words) or "as configured"


def take_axes(args: list[str]) -> list[Axis]:
    """Removes the options with commas in their values and returns them, in order; a ConfigError
    if one is given twice, or one of its values is empty or given twice."""
    axes: list[Axis] = []
    rest: list[str] = []
    pending = iter(list(args))
    for arg in pending:
        option, equals, value = arg.partition("=")
        if not arg.startswith("--"):
            rest.append(arg)
            continue
        if not equals:
            value = next(pending, "")
        if "," in value:
            axes.append(_axis(option, value))
        else:
            rest += [arg] if equals or not value else [arg, value]
    args[:] = rest
    seen = [axis.option for axis in axes]
    if twice := [option for option in seen if seen.count(option) > 1]:
        raise ConfigError(f"{twice[0]} is given twice, but is one axis of the sweep")
    return axes


def _axis(option: str, value: str) -> Axis:
    values = tuple(part.strip() for part in value.split(","))
    if "" in values:
        raise ConfigError(f"{option} is {value!r}, but must have a value between all commas")
    if twice := [part for part in values if values.count(part) > 1]:
        raise ConfigError(f"{option} is {value!r}, but must name {twice[0]} once")
    if option == "--run.seed":
        raise ConfigError("--run.seed cannot be an axis: --seeds N takes N seeds from it on")
    return Axis(option, values)


def cells(
    axes: Sequence[Axis], args: list[str], load: Callable[[list[str]], RunConfig]
) -> list[Cell]:
    """Every combination of the axes, beside the options that are the same for all; the last axis
    changes fastest. `load` makes a checked configuration of options."""
    found = []
    for pairs in itertools.product(*([(axis.option, x) for x in axis.values] for axis in axes)):
        config = load([*args, *itertools.chain.from_iterable(pairs)])
        found.append(Cell(tuple((option[2:], value) for option, value in pairs), config))
    return found


def with_seed(config: RunConfig, offset: int) -> RunConfig:
    """The configuration with its seed increased by `offset`."""
    run = dataclasses.replace(config.run, seed=config.run.seed + offset)
    return dataclasses.replace(config, run=run)
