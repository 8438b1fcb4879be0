"""Reads YAML files and command lines into one checked configuration, and writes it as YAML.

A YAML file holds values only. It is flattened to `--section.field=value` and read by the parser
that also reads the command line, so that one message serves both; what the file says then
becomes the default that the command line overrides. JAX is not imported here.
"""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeVar

import yaml

from gril_jax.config.run_config import RunConfig
from gril_jax.errors import ConfigError

from .command_line import nearest, parse

Schema = TypeVar("Schema")


def names() -> tuple[str, ...]:
    """The configurations shipped with the package."""
    files = resources.files("gril_jax.configs").iterdir()
    return tuple(sorted(f.name.removesuffix(".yaml") for f in files if f.name.endswith(".yaml")))


def find(name: str) -> Traversable:
    """A configuration file by its path, or the name of a shipped one; a ConfigError without it."""
    if name in names():
        return resources.files("gril_jax.configs") / f"{name}.yaml"
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
    name: str | None = None,
    overrides: Sequence[str] = (),
    *,
    schema: type[Schema] = RunConfig,
    prog: str = "gril train",
    description: str | None = None,
) -> Schema:
    """Loads a YAML file, overridden by the command line.

    Args:
      name: a path, the name of a shipped configuration, or None for the defaults alone.
      overrides: options such as `("--ppo.num-envs", "64")`.
      schema: what to build: `RunConfig`, or some of its sections.
      prog, description: the command as it appears in the help, and the help's first paragraph.

    Raises:
      ConfigError: the file or an option is unknown, of the wrong type or out of range.
    """
    default, before = None, names()
    if name is not None:
        before = ()
        file = find(name)
        try:
            tree = _with_task_found(_read(file), file)
            whole = parse(RunConfig, [*_flags(tree, "")], prog=prog)
        except ConfigError as error:
            raise ConfigError(f"{file}: {error}") from None
        sections = {field.name for field in dataclasses.fields(schema)}
        default = schema(**{name: getattr(whole, name) for name in sections})
        if not overrides:
            return default
    return parse(
        schema, overrides, default=default, prog=prog, description=description, before=before
    )


def _with_task_found(tree: dict[str, Any], file: Traversable) -> dict[str, Any]:
    """The file's tree, in which the file of a user's own task is looked for beside it."""
    env = tree.get("env", {})
    name = str(env.get("name", ""))
    if ".py:" not in name or not isinstance(file, Path):
        return tree
    return tree | {"env": env | {"name": str(file.absolute().parent / Path(name).expanduser())}}


def to_yaml(config: Any) -> str:
    """The configuration as YAML, which `load` reads back to an equal one."""
    return yaml.safe_dump(_tree(config), sort_keys=False, allow_unicode=True)


def _tree(config: Any) -> dict[str, Any]:
    tree = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            value = _tree(value)
        tree[field.name.rstrip("_")] = list(value) if isinstance(value, tuple) else value
    return tree


class _Loader(yaml.SafeLoader):
    """A YAML loader that rejects duplicate keys; PyYAML's safe loader silently keeps the last."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Refuses merged maps, a few lines of which can unpack to more than fits into memory."""
        if any(key.tag == "tag:yaml.org,2002:merge" for key, _ in node.value):
            raise ConfigError("'<<' merges maps, but each section must be written out")
        super().flatten_mapping(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen: dict[str, int] = {}
        names = [key for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        for key in names:
            line = key.start_mark.line + 1
            if key.value in seen:
                raise ConfigError(
                    f"{key.value!r} is given twice, in line {seen[key.value]} and in line "
                    f"{line}, but each key may appear once"
                )
            seen[key.value] = line
        return super().construct_mapping(node, deep)


def _read(file: Traversable) -> dict[str, Any]:
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
    if tree is None:
        return {}
    if not isinstance(tree, dict):
        raise ConfigError("the file must hold sections such as 'env:' with fields below them")
    _check(tree)
    return tree


def _check(tree: Mapping[Any, Any]) -> None:
    """Checks the structure of the file: sections of fields, and lists where the schema has them."""
    sections = {field.name: field.default for field in dataclasses.fields(RunConfig)}
    for section, fields in tree.items():
        if section not in sections:
            hint = nearest(str(section), [*sections]) or f" beside {', '.join(sections)}"
            raise ConfigError(f"there is no section {section!r}{hint}")
        if not isinstance(fields, dict):
            raise ConfigError(f"section {section!r} must hold fields, each on a line of its own")
        defaults = _tree(sections[section])
        for key, value in fields.items():
            path = f"{section}.{key}"
            if key not in defaults:
                hint = nearest(str(key), [*defaults]) or f" beside {', '.join(defaults)}"
                raise ConfigError(f"there is no field {path}{hint}")
            is_list = isinstance(defaults[key], list)
            if isinstance(value, dict if is_list else dict | list):
                raise ConfigError(f"{path} must be a single value")
            if is_list and not isinstance(value, list):
                raise ConfigError(f"{path} is {value!r}, but must be a list such as [a, b]")
            if is_list and any(isinstance(x, dict | list) for x in value):
                raise ConfigError(f"{path} must be a list of single values")
            for text in map(_text, value if is_list else [value]):
                if text is None:
                    raise ConfigError(f"{path} is a number of too many digits")
                if is_list and text.startswith("--"):  # it would be read as an option
                    raise ConfigError(f"{path} holds {text!r:.60}, but no value begins with '--'")


def _text(value: Any) -> str | None:
    """The value as the command line has it; None for a number of more digits than Python writes."""
    try:
        return str(value)
    except ValueError:
        return None


def _flags(tree: Mapping[str, Any], prefix: str) -> Iterator[str]:
    for key, value in tree.items():
        name = f"{prefix}{key}".replace("_", "-")
        if isinstance(value, dict):
            yield from _flags(value, f"{name}.")
        elif isinstance(value, list):
            yield f"--{name}"
            yield from map(str, value)
        else:
            yield f"--{name}={value}"
