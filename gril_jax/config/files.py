"""Configurations by their names or files, as sections, and as YAML.

A YAML file holds values of sections, above those of the configuration that its `base` names. It is
read as a command line of as many options, so that one message serves both; a command line is then
read above what the file says. JAX is not imported here.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import yaml

from gril_jax.config.run_config import RunConfig, Sections
from gril_jax.errors import ConfigError

from .command_line import nearest, parse


def names() -> tuple[str, ...]:
    """The configurations shipped with the package; a `_` begins what is only a base of others."""
    files = resources.files("gril_jax.configs").iterdir()
    stems = (f.name.removesuffix(".yaml") for f in files if f.name.endswith(".yaml"))
    return tuple(sorted(stem for stem in stems if not stem.startswith("_")))


def find(name: str) -> Traversable:
    """A configuration file by its path, or the name of a shipped one; a ConfigError without it."""
    shipped = resources.files("gril_jax.configs") / f"{name}.yaml"
    if name.isidentifier() and shipped.is_file():
        return shipped
    path = Path(name)
    if path.is_file():
        return path
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        fault = "is a folder" if path.is_dir() else "does not exist"
        raise ConfigError(f"configuration file {name} {fault}, but must be a YAML file")
    raise ConfigError(
        f"there is no configuration {name!r}{nearest(name, names())}: the shipped ones are "
        f"{', '.join(names())}, and any other is given as the path of its YAML file"
    )


def load(
    name: str | None = None, overrides: Sequence[str] = (), *, prog: str = "gril train"
) -> RunConfig:
    """Loads a configuration, overridden by options of the command line.

    Args:
      name: a path, the name of a shipped configuration, or None for the defaults alone.
      overrides: options such as `("--ppo.num-envs", "64")`.
      prog: the command whose help the sentence of an error names.

    Raises:
      ConfigError: the file or an option is unknown, of the wrong type or out of range.
    """
    given = sections(name)
    return RunConfig.of(
        parse(Sections, overrides, default=given, prog=prog) if overrides else given
    )


def sections(name: str | None) -> Sections:
    """The sections of a configuration by its name or path; the defaults for None. A ConfigError
    names the file that is at fault."""
    if name is None:
        return Sections()
    file = find(name)
    given = _read(file, ())
    try:
        RunConfig.of(given)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    return given


def _read(file: Traversable, above: tuple[str, ...]) -> Sections:
    """The sections of a file, above its base; `above` are the files that it is a base of."""
    try:
        tree = _tree(file)
        base = tree.pop("base", None)
        if str(file) in above:
            raise ConfigError(f"its base leads back to itself, by way of {above[-1]}")
        under = None if base is None else find(_beside(base, file))
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    default = Sections() if under is None else _read(under, (*above, str(file)))
    try:
        return parse(Sections, [*_options(tree, file)], default=default, prog="gril train")
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None


def _beside(name: str, file: Traversable) -> str:
    """A path that a file names, which is relative to its folder; a shipped name as it is."""
    path = Path(name).expanduser()
    is_name = path.suffix not in (".yaml", ".yml") or not isinstance(file, Path)
    return name if is_name else str(file.absolute().parent / path)


def _options(tree: Mapping[str, Any], file: Traversable) -> Iterator[str]:
    """The file's values as a command line; a user's own task is looked for beside the file."""
    for section, fields in tree.items():
        for field, value in fields.items():
            option = f"--{section}.{field}".replace("_", "-")
            is_file = ".py:" in str(value) or str(value).endswith(".py")
            if option == "--env.name" and is_file and isinstance(file, Path):
                value = file.absolute().parent / Path(value).expanduser()
            if isinstance(value, list):
                yield from (option, *map(str, value))
            else:
                yield f"{option}={value}"


def to_yaml(config: Any) -> str:
    """The configuration as YAML, which `load` reads back to an equal one; fields have the names of
    the command line, and tuples are lists."""
    plain = {
        section: {
            name.rstrip("_"): list(value) if isinstance(value, tuple) else value
            for name, value in fields.items()
        }
        for section, fields in dataclasses.asdict(config).items()
    }
    return yaml.safe_dump(plain, sort_keys=False, allow_unicode=True)


class _Loader(yaml.SafeLoader):
    """A YAML loader that rejects duplicate keys; PyYAML's safe loader silently keeps the last."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Refuses merged maps, a few lines of which can unpack to more than fits into memory."""
        if any(key.tag == "tag:yaml.org,2002:merge" for key, _ in node.value):
            raise ConfigError("'<<' merges maps, but each section must be written out")
        super().flatten_mapping(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen: dict[str, int] = {}
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            line = key.start_mark.line + 1
            if key.value in seen:
                raise ConfigError(
                    f"{key.value!r} is given twice, in line {seen[key.value]} and in line "
                    f"{line}, but each key may appear once"
                )
            seen[key.value] = line
        return super().construct_mapping(node, deep)


def mapping(file: Traversable) -> dict[Any, Any]:
    """The keys of a file with what stands below them, of any structure; {} for an empty file."""
    try:
        tree = _Loader(file.read_text(encoding="utf-8")).get_single_data()
    except OSError as error:
        raise ConfigError(f"the file cannot be read ({error.strerror})") from None
    # PyYAML's own constructors raise much over a value that is not of its tag, as `!!int ''`.
    except (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, RecursionError, TypeError,
            ValueError) as error:  # fmt: skip
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
        where = f"line {mark.line + 1}: " if mark else ""
        raise ConfigError(f"{where}the file is not YAML ({problem or 'not text'})") from None
    if not isinstance(tree, dict | None):
        raise ConfigError("the file must hold sections such as 'env:' with fields below them")
    return tree or {}


def _tree(file: Traversable) -> dict[str, Any]:
    """The sections of a file, and the name of its `base` if it has one; of the right structure, but
    with values of any type."""
    tree = mapping(file)
    if not isinstance(tree.get("base", ""), str):
        raise ConfigError("base must be the name of one configuration, or the path of its file")
    for section, fields in tree.items():
        if section != "base":
            _check(section, fields)
    return tree


def _check(section: Any, fields: Any) -> None:
    """Checks the structure of a section: its fields, and lists where the schema has them."""
    known = {field.name: field.default for field in dataclasses.fields(RunConfig)}
    if section not in known:
        hint = nearest(str(section), known) or f" beside {', '.join(known)}"
        raise ConfigError(f"there is no section {section!r}{hint}")
    if not isinstance(fields, dict):
        raise ConfigError(f"section {section!r} must hold fields, each on a line of its own")
    defaults = {name.rstrip("_"): value for name, value in vars(known[section]).items()}
    for key, value in fields.items():
        path = f"{section}.{key}"
        if key not in defaults:
            hint = nearest(str(key), defaults) or f" beside {', '.join(defaults)}"
            raise ConfigError(f"there is no field {path}{hint}")
        _check_value(path, value, is_list=isinstance(defaults[key], tuple))


def _check_value(path: str, value: Any, *, is_list: bool) -> None:
    if isinstance(value, dict if is_list else dict | list):
        raise ConfigError(f"{path} must be a single value")
    if is_list and not isinstance(value, list):
        raise ConfigError(f"{path} is {value!r}, but must be a list such as [a, b]")
    if is_list and any(isinstance(x, dict | list) for x in value):
        raise ConfigError(f"{path} must be a list of single values")
    for one in value if is_list else [value]:
        try:
            text = str(one)
        except ValueError:
            raise ConfigError(f"{path} is a number of too many digits") from None
        if is_list and text.startswith("--"):  # it would be read as an option
            raise ConfigError(f"{path} holds {text!r:.60}, but no value begins with '--'")
