"""A study as a YAML file: a preset, rows that change some of its fields, and what is measured.

    base: match_regions
    seeds: 5
    changes: {run.evaluations: 10}              # of all rows
    blocks:
      paper: {encoder.kind: paper, loss.near_cost_fraction: 0.8}
    rows:
      ours: {extends: paper, pretrain.num_perturbations: 4}
    measure:
      audit: {variants: [demo]}

`product` instead of `rows` has a row for each combination: {join: " on ", of: [{...}, {...}],
except: [...]}. Neither JAX nor MuJoCo is imported here.
"""

import dataclasses
import fnmatch
import functools
import itertools
import types
import typing
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from gril_jax.config import RunConfig
from gril_jax.config.command_line import nearest
from gril_jax.config.files import mapping
from gril_jax.errors import ConfigError

_PACKAGE = "gril_jax.experiments.studies"
# What can be measured of a row's rewards or policies, and the options of each.
MEASURES = {
    "profiles": set(), "audit": {"variants", "starts", "ascents"}, "separation": set(),
    "files": set(), "variants": {"starts"}, "elsewhere": {"starts", "states"},
}  # fmt: skip

Change = Mapping[str, Any]  # dotted fields of the configuration, such as "loss.touch", to values


@dataclasses.dataclass(frozen=True)
class Study:
    """A study as its file describes it, before the command line has its say."""

    name: str
    about: str = ""
    """What it compares, in a sentence."""
    base: str | None = None
    """The configuration that all rows change."""
    rows: Mapping[str, Change] = dataclasses.field(default_factory=dict)
    """What each row changes."""
    changes: Change = dataclasses.field(default_factory=dict)
    """Fields of all rows, below what a row says."""
    over: Change = dataclasses.field(default_factory=dict)
    """Fields of all rows, above what a row says."""
    default: Sequence[str] = ("*",)
    """Names or patterns of the rows that are made unless others are chosen."""
    sets: str | None = None
    """Folder with a demonstration set for each task, in a folder of its name."""
    seeds: int = 5
    """Rewards and policies of each row."""
    policies: bool = True
    """True if policies are trained; otherwise rewards alone."""
    at_once: int | None = None
    """Largest number of policies in one program; None: as many as fit."""
    evaluate: Sequence[str] = ()
    """Variants of the task that policies are evaluated in while they are trained; the first one's
    success is `success`. Empty: the variant with many starts."""
    measure: Mapping[str, Mapping[str, Any]] = dataclasses.field(default_factory=dict)
    """What is measured, with options: see `MEASURES`."""
    published: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    """Column to published numbers of rows, which stand beside ours."""


# --- the file

_QUICK = {"seeds": "seeds", "base": "base", "rows": "default", "changes": "over"}


def names() -> tuple[str, ...]:
    """The studies shipped with the package, in `experiments/studies`."""
    files = resources.files(_PACKAGE).iterdir()
    return tuple(sorted(f.name.removesuffix(".yaml") for f in files if f.name.endswith(".yaml")))


def is_study(name: str | None) -> bool:
    """True for the name of a shipped study, and for a YAML file that has rows."""
    if name is None or name in names():
        return name is not None
    try:
        return Path(name).is_file() and not {"rows", "product"}.isdisjoint(mapping(Path(name)))
    except ConfigError:  # which is told where it is read as a configuration
        return False


def load(name: str, *, quick: bool = False) -> Study:
    """Reads a study by its name or path, or the smaller one that `quick` of its file describes.

    A malformed file is a ConfigError."""
    shipped = name in names()
    file = resources.files(_PACKAGE) / f"{name}.yaml" if shipped else Path(name)
    try:
        return _study(mapping(file), Path(name).stem, quick=quick)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None


def _study(tree: dict[str, Any], name: str, *, quick: bool) -> Study:
    fields = {field.name for field in dataclasses.fields(Study)} - {"name", "over"}
    own = {"product", "blocks", "quick"}
    for key, value in tree.items():
        if key not in fields | own:
            raise ConfigError(f"there is no key {key!r}{nearest(str(key), [*fields, *own])}")
        if key in ("rows", "blocks", "changes", "measure", "quick", "published"):
            if not isinstance(value, dict):
                raise ConfigError(f"{key} must hold names, each with what belongs to it")
    measure = {kind: options or {} for kind, options in tree.get("measure", {}).items()}
    for kind, options in measure.items():
        if kind not in MEASURES:
            raise ConfigError(f"measure has {kind!r}, but must have of {', '.join(MEASURES)}")
        if stray := {*options} - MEASURES[kind]:
            raise ConfigError(f"measure.{kind} has no option {min(stray)!r}")
    seeds = tree.get("seeds", Study.seeds)
    if type(seeds) is not int or seeds < 1:
        raise ConfigError(f"seeds is {seeds!r}, but must be a whole number of at least 1")
    blocks = tree.get("blocks", {})
    rows = {row: _extended(change, blocks, (row,)) for row, change in tree.get("rows", {}).items()}
    if "product" in tree:
        rows |= _product(tree["product"], blocks)
    if not rows:
        raise ConfigError("the study has no rows")
    if stray := [row for row in rows if "," in row]:
        raise ConfigError(f"the row {stray[0]!r} has a comma, but --rows is a list with commas")
    given = {key: value for key, value in tree.items() if key in fields}
    if quick and "quick" not in tree:
        raise ConfigError("the study has no smaller version, so there is no use for --quick")
    smaller = {_QUICK[x]: y for x, y in tree["quick"].items() if x in _QUICK} if quick else {}
    return Study(name, **given | {"measure": measure, "rows": rows} | smaller)


def _product(tree: Mapping[str, Any], blocks: Mapping[str, Any]) -> dict[str, Change]:
    """A row for each combination, whose name joins those of its parts."""
    axes = [
        {name: _extended(change, blocks, (name,)) for name, change in axis.items()}
        for axis in tree["of"]
    ]
    found: dict[str, Change] = {}
    for combination in itertools.product(*(axis.items() for axis in axes)):
        row = tree.get("join", " with ").join(name for name, _ in combination)
        found[row] = functools.reduce(_over, (part for _, part in combination), {})
    without = chosen(tree.get("except", ()), [*found], "except")
    return {row: change for row, change in found.items() if row not in without}


def _extended(change: Change | None, blocks: Mapping[str, Any], trail: tuple[str, ...]) -> Change:
    """What a row or block changes, with all that the blocks change which it extends."""
    own = dict(change or {})
    above = own.pop("extends", ())
    found: Change = {}
    for name in [above] if isinstance(above, str) else above:
        if name not in blocks:
            hint = nearest(name, [*blocks])
            raise ConfigError(f"{trail[0]!r} extends {name!r}{hint}, but there is no such block")
        if name in trail[1:]:
            raise ConfigError(f"the block {name!r} extends itself")
        found = _over(found, _extended(blocks[name], blocks, (*trail, name)))
    return _over(found, own)


def _over(change: Change, other: Change) -> dict[str, Any]:
    """Both changes, of which the other counts; factors are multiplied."""
    found = dict(change)
    for path, value in other.items():
        factors = scale(found.get(path)), scale(value)
        found[path] = value if None in factors else f"x{factors[0] * factors[1]}"
    return found


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


def changed(config: Any, change: Change) -> Any:
    """The configuration, or its sections, with some fields set to other values; "x0.5" is half of a
    number's own.

    Raises ConfigError if there is no such field, or if a value is of the wrong type or range.
    """
    parts: dict[str, Any] = {}
    for path, value in change.items():
        section, field = located(path)
        part = parts.get(section, getattr(config, section))
        kind = _kinds(type(part))[field]
        parts[section] = dataclasses.replace(
            part, **{field: _fitted(path, value, kind, getattr(part, field))}
        )
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
    known = {
        f"{one.name}.{name}": None
        for one in dataclasses.fields(RunConfig)
        for name in _kinds(type(one.default))
    }
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
def _kinds(section: type) -> dict[str, Any]:
    hints = typing.get_type_hints(section)
    return {field.name: hints[field.name] for field in dataclasses.fields(section)}


def _fitted(path: str, value: Any, kind: Any, own: Any) -> Any:
    """The value as the field has it: a tuple for a list, a float for a whole number."""
    factor = scale(value)
    if factor is not None and isinstance(own, int | float):
        return type(own)(round(factor * own) if isinstance(own, int) else factor * own)
    is_union = typing.get_origin(kind) in (typing.Union, types.UnionType)
    words: list[str] = []
    for member in typing.get_args(kind) if is_union else (kind,):
        origin, args = typing.get_origin(member), typing.get_args(member)
        name = getattr(member, "__name__", str(member))
        words += map(repr, args) if origin is Literal else [name]
        if origin is Literal and value in args:
            return value
        if origin is tuple and isinstance(value, list | tuple):
            numbers = all(isinstance(x, int | float) for x in value)
            if args[0] is not float or numbers:
                return tuple(map(float, value)) if args[0] is float else tuple(value)
        if type(value) is member or (member is float and type(value) is int):
            return member(value) if member is float else value
    said = f"one of {', '.join(words)}" if len(words) > 1 else f"of the kind {words[0]}"
    raise ConfigError(f"{path} is {value!r}, but must be {said}")
