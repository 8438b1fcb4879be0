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

from gril_jax.config.run_config import RunConfig, Sections
from gril_jax.errors import ConfigError

from . import yaml_tree
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
    """What a file says, above its base; `above` are the files that it is a base of."""
    try:
        tree = yaml_tree.read(file)
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
            if option == "--env.name" and ".py:" in str(value) and isinstance(file, Path):
                value = file.absolute().parent / Path(value).expanduser()
            if isinstance(value, list):
                yield from (option, *map(str, value))
            else:
                yield f"{option}={value}"


def to_yaml(config: Any) -> str:
    """The configuration as YAML, which `load` reads back to an equal one."""
    return yaml_tree.written(dataclasses.asdict(config))
