"""YAML as a tree of sections, fields and values; whatever is wrong is a ConfigError."""

import dataclasses
from collections.abc import Mapping
from importlib.resources.abc import Traversable
from typing import Any

import yaml

from gril_jax.errors import ConfigError

from .command_line import nearest
from .run_config import RunConfig


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


def mapping(file: Traversable) -> dict[str, Any]:
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


def read(file: Traversable) -> dict[str, Any]:
    """The sections of a file, and the name of its `base` if it has one; of the right structure, but
    with values of any type."""
    tree = mapping(file)
    if not isinstance(tree.get("base", ""), str):
        raise ConfigError("base must be the name of one configuration, or the path of its file")
    for section, fields in tree.items():
        if section != "base":
            _check(section, fields)
    return tree


def written(tree: Mapping[str, Mapping[str, Any]]) -> str:
    """Sections as YAML, with fields as the command line names them, and tuples as lists."""
    plain = {
        section: {
            name.rstrip("_"): list(value) if isinstance(value, tuple) else value
            for name, value in fields.items()
        }
        for section, fields in tree.items()
    }
    return yaml.safe_dump(plain, sort_keys=False, allow_unicode=True)


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
