"""The rows of a study: configurations by their names, each one preset with some fields changed.

Neither JAX nor MuJoCo is imported here: the command line looks at rows first.
"""

import dataclasses
import fnmatch
import functools
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

from gril_jax.config import RunConfig
from gril_jax.config.command_line import nearest
from gril_jax.config.tables import REWARDS
from gril_jax.errors import ConfigError

Change = Mapping[str, Any]  # dotted fields of the configuration, such as "loss.touch", to values


class Row(NamedTuple):
    """One row of a study with one of its seeds: a run."""

    cell: int  # place of the row among all of the study
    seed: int  # place of the seed among the row's
    config: RunConfig


def chosen(patterns: Sequence[str], names: Sequence[str], where: str = "--rows") -> list[str]:
    """The names that patterns such as "ours at level *" match, each once, in the patterns' order.

    Raises ConfigError for a pattern that matches none.
    """
    found: dict[str, None] = {}
    for pattern in patterns:
        matched = [pattern] if pattern in names else fnmatch.filter(names, pattern)
        if not matched:
            hint = nearest(pattern, [*names])
            raise ConfigError(
                f"{where} names {pattern!r}{hint}, but the rows are: {', '.join(names)}"
            )
        found |= dict.fromkeys(matched)
    return [*found]


# --- fields


def changed(config: RunConfig, change: Change) -> RunConfig:
    """The configuration with some fields set to other values; "x0.5" is half of a number's own.

    Raises ConfigError if there is no such field, or if a value is of the wrong type or range.
    """
    parts: dict[str, Any] = {}
    for path, value in change.items():
        section, field = located(path)
        part = parts.get(section, getattr(config, section))
        value = _fitted(path, value, _kinds(type(part))[field], getattr(part, field))
        parts[section] = dataclasses.replace(part, **{field: value})
    return dataclasses.replace(config, **parts)


def difference(first: RunConfig, second: RunConfig) -> dict[str, Any]:
    """What makes the second configuration of the first, as `changed` takes it."""
    return {
        f"{section.name}.{name}": value
        for section in dataclasses.fields(RunConfig)
        for name, value in vars(getattr(second, section.name)).items()
        if getattr(getattr(first, section.name), name) != value
    }


def located(path: str) -> tuple[str, str]:
    """The section and the field of a dotted path; ConfigError if there is none."""
    section, _, field = path.partition(".")
    known = _paths()
    if path not in known and f"{path}_" not in known:
        raise ConfigError(f"there is no field {path!r}{nearest(path, [*known])}")
    return section, field if path in known else f"{field}_"


def scale(value: Any) -> float | None:
    """The factor of a value such as "x0.5"; None for any other."""
    if not isinstance(value, str) or not value.startswith("x"):
        return None
    try:
        return float(value[1:])
    except ValueError:
        return None


@functools.cache
def _paths() -> dict[str, None]:
    usual = RunConfig()
    return {
        f"{section.name}.{field.name}": None
        for section in dataclasses.fields(usual)
        for field in dataclasses.fields(getattr(usual, section.name))
    }


@functools.cache
def _kinds(section: type) -> dict[str, Any]:
    return typing.get_type_hints(section)


def _fitted(path: str, value: Any, kind: Any, own: Any) -> Any:
    """The value as the field has it: a tuple for a list, a float for a whole number."""
    factor = scale(value)
    if factor is not None and isinstance(own, int | float):
        return type(own)(round(factor * own) if isinstance(own, int) else factor * own)
    value = tuple(value) if isinstance(value, list) else value
    for member in _members(kind):
        found = float(value) if member is float and type(value) is int else value
        if _is(found, member):
            return tuple(map(float, found)) if typing.get_args(member)[:1] == (float,) else found
    raise ConfigError(f"{path} is {value!r}, but must be {_in_words(kind)}")


def _members(kind: Any) -> tuple[Any, ...]:
    is_union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    return typing.get_args(kind) if is_union else (kind,)


def _is(value: Any, kind: Any) -> bool:
    if typing.get_origin(kind) is Literal:
        return value in typing.get_args(kind)
    if typing.get_origin(kind) is tuple:
        item = typing.get_args(kind)[0]
        wanted = (int, float) if item is float else object
        return isinstance(value, tuple) and all(isinstance(x, wanted) for x in value)
    return type(value) is kind


def _in_words(kind: Any) -> str:
    words = []
    for member in _members(kind):
        if typing.get_origin(member) is Literal:
            words += map(repr, typing.get_args(member))
        else:
            words.append(getattr(member, "__name__", str(member)))
    return f"one of {', '.join(words)}" if len(words) > 1 else f"of the kind {words[0]}"


# --- what becomes of a row


def learns(config: RunConfig) -> bool:
    """True if a reward is learned for the policy."""
    return REWARDS[config.run.reward_form].learns


def without_twins(rows: Mapping[str, RunConfig]) -> tuple[dict[str, RunConfig], dict[str, str]]:
    """The rows but for those with the results of an earlier one, and these with its name: a policy
    that learns no reward ignores how one would be learned."""
    usual, kept, twins = RunConfig(), {}, {}
    first: dict[RunConfig, str] = {}
    for name, config in rows.items():
        ignored = [] if learns(config) else ["encoder", "pool", "loss", "pretrain"]
        if ignored and not getattr(getattr(config, config.run.algorithm), "video_state_resets", 0):
            ignored.append("demos")
        counts = dataclasses.replace(config, **{k: getattr(usual, k) for k in ignored})
        if (same := first.setdefault(counts, name)) == name:
            kept[name] = config
        else:
            twins[name] = same
    return kept, twins
