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

`rows` may be a product: {join: " on ", of: [{...}, {...}], except: [...]} has a row for each
combination. Studies that are shipped have names, those of `experiments/studies`. Neither JAX nor
MuJoCo is imported here.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

from gril_jax.config.command_line import nearest
from gril_jax.errors import ConfigError

from .rows import Change, chosen, scale

_PACKAGE = "gril_jax.experiments.studies"
# What can be measured of a row's rewards or policies, and the options of each.
MEASURES = {
    "audit": {"variants", "starts", "ascents"}, "profiles": set(), "separation": set(),
    "evaluation": set(), "files": set(), "variants": {"starts"},
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Study:
    """All of a study that is not in the configurations of its rows."""

    name: str
    about: str = ""
    """What it compares, in a sentence."""
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
    """Column to published numbers of rows, which are printed beside ours."""


@dataclasses.dataclass(frozen=True)
class Recipe:
    """A study before the command line has its say."""

    study: Study
    base: str | None
    rows: Mapping[str, Change]
    changes: Change = dataclasses.field(default_factory=dict)
    """Fields of all rows, below what a row says."""
    over: Change = dataclasses.field(default_factory=dict)
    """Fields of all rows, above what a row says."""
    default: Sequence[str] = ("*",)
    """Names or patterns of the rows that are made unless others are chosen."""
    sets: str | None = None
    """Folder with a demonstration set for each task, in a folder of its name."""

    def quick(self, smaller: Mapping[str, Any]) -> "Recipe":
        """The smaller version that `quick` of its file describes."""
        study = dataclasses.replace(self.study, seeds=smaller.get("seeds", self.study.seeds))
        return dataclasses.replace(
            self, study=study, base=smaller.get("base", self.base),
            default=smaller.get("rows", self.default), over=smaller.get("changes", {}),
        )  # fmt: skip


def names() -> tuple[str, ...]:
    """The studies shipped with the package."""
    files = resources.files(_PACKAGE).iterdir()
    return tuple(sorted(f.name.removesuffix(".yaml") for f in files if f.name.endswith(".yaml")))


def is_study(name: str | None) -> bool:
    """True for the name of a shipped study, and for a YAML file that has rows."""
    if name is None or name in names():
        return name is not None
    path = Path(name)
    return path.is_file() and not {"rows", "product"}.isdisjoint(_keys(path))


def load(name: str, *, quick: bool = False) -> Recipe:
    """Reads a study by its name or path; ConfigError if it is not as it must be."""
    shipped = name in names()
    file = resources.files(_PACKAGE) / f"{name}.yaml" if shipped else Path(name)
    try:
        tree = _read(file)
        made = _made(tree, name if shipped else Path(name).stem)
        if quick and "quick" not in tree:
            raise ConfigError("the study has no smaller version, so there is no use for --quick")
        return made.quick(tree["quick"]) if quick else made
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None


def _made(tree: Mapping[str, Any], name: str) -> Recipe:
    fields = {field.name for field in dataclasses.fields(Study)} - {"name"}
    own = {"base", "rows", "product", "blocks", "changes", "default", "sets", "quick"}
    for key in tree:
        if key not in fields | own:
            raise ConfigError(f"there is no key {key!r}{nearest(str(key), [*fields, *own])}")
    measure = {kind: options or {} for kind, options in tree.get("measure", {}).items()}
    for kind, options in measure.items():
        if kind not in MEASURES:
            raise ConfigError(f"measure has {kind!r}, but must have of {', '.join(MEASURES)}")
        if stray := {*options} - MEASURES[kind]:
            raise ConfigError(f"measure.{kind} has no option {min(stray)!r}")
    seeds = tree.get("seeds", Study.seeds)
    if type(seeds) is not int or seeds < 1:
        raise ConfigError(f"seeds is {seeds!r}, but must be a whole number of at least 1")
    given = {key: value for key, value in tree.items() if key in fields}
    study = Study(name, **given | {"measure": measure})
    blocks = tree.get("blocks", {})
    rows = {row: _extended(change, blocks, (row,)) for row, change in tree.get("rows", {}).items()}
    if "product" in tree:
        rows |= _product(tree["product"], blocks)
    if not rows:
        raise ConfigError("the study has no rows")
    if stray := [row for row in rows if "," in row]:
        raise ConfigError(f"the row {stray[0]!r} has a comma, but --rows is a list with commas")
    kept = {key: tree[key] for key in ("changes", "default", "sets") if key in tree}
    return Recipe(study, tree.get("base"), rows, **kept)


def _product(tree: Mapping[str, Any], blocks: Mapping[str, Any]) -> dict[str, Change]:
    """A row for each combination, whose name joins those of its parts."""
    axes = [
        {name: _extended(change, blocks, (name,)) for name, change in axis.items()}
        for axis in tree["of"]
    ]
    found: dict[str, Change] = {}
    for combination in itertools.product(*(axis.items() for axis in axes)):
        row = tree.get("join", " with ").join(name for name, _ in combination)
        change: Change = {}
        for _, part in combination:
            change = _over(change, part)
        found[row] = change
    without = chosen(tree.get("except", ()), [*found], "except")
    return {row: change for row, change in found.items() if row not in without}


def _extended(
    change: Mapping[str, Any] | None, blocks: Mapping[str, Any], trail: tuple[str, ...]
) -> Change:
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


# --- the file


class _Loader(yaml.SafeLoader):
    """A YAML loader that rejects duplicate keys; PyYAML's safe loader silently keeps the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if twice := [key for key in keys if keys.count(key) > 1]:
            line = node.start_mark.line + 1
            raise ConfigError(f"{twice[0]!r} is given twice in what begins at line {line}")
        return super().construct_mapping(node, deep)


def _read(file: Traversable) -> dict[str, Any]:
    try:
        tree = _Loader(file.read_text(encoding="utf-8")).get_single_data()
    except OSError as error:
        raise ConfigError(f"the file cannot be read ({error.strerror})") from None
    except (yaml.YAMLError, ValueError) as error:
        problem = " ".join(str(error).split())
        raise ConfigError(f"the file is not YAML ({problem})") from None
    if not isinstance(tree, dict):
        raise ConfigError("the file must hold keys such as 'rows:' with rows below it")
    for key, value in tree.items():
        if key in ("rows", "blocks", "changes", "measure", "quick", "published"):
            if not isinstance(value, dict):
                raise ConfigError(f"{key} must hold names, each with what belongs to it")
    return tree


def _keys(file: Path) -> set[str]:
    try:
        return {*_read(file)}
    except ConfigError:
        return set()
