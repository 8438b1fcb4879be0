"""An encoder's configuration as JSON and back: its kind, and its fields by name.

>>> to_json(KINDS["mlp"](num_classes=3))["kind"]
'mlp'
>>> from_json({"kind": "pixel", "latent": 8})
PixelConfig(latent=8, pixels=None, precision='float32')
"""

import dataclasses
import typing
from collections.abc import Mapping
from types import NoneType, UnionType
from typing import Any, Literal

from gril_jax.config.tables import ENCODERS, find
from gril_jax.errors import ConfigError

from .encoder import AnyConfig

KINDS = {one.saved or name: find(one.config) for name, one in ENCODERS.items()}

# A file must not make its reader build a network without end.
_MOST = {"rounds": 100, "history": 100, "members": 100}
_MOST_OF_OTHERS = 2**20


def to_json(config: AnyConfig) -> dict[str, Any]:
    """`kind` and the configuration's fields.

    Raises:
      ConfigError: there is no encoder for this kind of config.
    """
    for kind, chosen in KINDS.items():
        if type(config) is chosen:
            return {"kind": kind, **dataclasses.asdict(config)}
    raise ConfigError(
        f"config is a {type(config).__name__}; it must be one of "
        f"{', '.join(chosen.__name__ for chosen in KINDS.values())}."
    )


def from_json(about: Any) -> AnyConfig:
    """The configuration; missing fields take their defaults.

    Raises:
      ConfigError: the kind or a field is unknown, missing, of another type or out of range.
    """
    if not isinstance(about, Mapping) or about.get("kind") not in [*KINDS]:
        kind = about.get("kind") if isinstance(about, Mapping) else about
        raise ConfigError(f"encoder.kind is {kind!r:.60}; it must be one of {', '.join(KINDS)}.")
    chosen = KINDS[about["kind"]]
    types = typing.get_type_hints(chosen)
    values = {name: value for name, value in about.items() if name != "kind"}
    for name, value in values.items():
        if name not in types:
            raise ConfigError(
                f"encoder.{name} is unknown to this version of gril-jax; a {about['kind']} encoder "
                f"has {', '.join(types)}."
            )
        if not _fits(value, types[name]):
            wanted = getattr(types[name], "__name__", types[name])
            raise ConfigError(f"encoder.{name} is {value!r:.60}; it must be of type {wanted}.")
        most = _MOST.get(name, _MOST_OF_OTHERS)
        if type(value) is int and value > most:
            raise ConfigError(f"encoder.{name} is {value!r:.60}; it must be at most {most}.")
    if "num_classes" in types and "num_classes" not in values:
        raise ConfigError("encoder.num_classes is missing; it must be the number of classes.")
    return chosen(**values)


def _fits(value, kind):
    if typing.get_origin(kind) in (typing.Union, UnionType):
        return any(_fits(value, one) for one in typing.get_args(kind))
    if typing.get_origin(kind) is Literal:
        return value in typing.get_args(kind)
    if kind is NoneType:
        return value is None
    return type(value) is kind or (kind is float and type(value) is int)
