"""Types shared by the modules: scene graphs and batches of demonstrations; `checked` holds a public
function to its annotations.

Shapes use N for objects (nodes), E = N (N - 1) for edges, T for frames and B for demonstrations.
Positions and sizes are in world units, never in pixels, so that videos with different framing mix.
"""

import functools
import inspect
import typing
from abc import ABCMeta
from collections.abc import Callable
from types import NoneType, UnionType
from typing import Any, NamedTuple, TypeVar

import jax.numpy as jnp
import jraph
from jaxtyping import Array, Bool, Float, Int, UInt8

from .errors import ConfigError, ShapeError

_Function = TypeVar("_Function", bound=Callable[..., Any])
_DTYPES = {"float32", "int32", "bool"}  # not those of keys and pictures
_NAMED = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


class Nodes(NamedTuple):
    """The objects of one frame: the `nodes` of a `SceneGraph`."""

    center: Float[Array, "N 2"]  # world units
    size: Float[Array, "N 2"]  # width and height of the axis-aligned box, world units
    label: Int[Array, "N"]  # index into the task's class names
    active: Bool[Array, "N"]  # has moved since the episode began (Eq. 4)
    is_robot: Bool[Array, "N"]
    present: Bool[Array, "N"]  # False for padding


# A fully connected `jraph.GraphsTuple` of one frame. `nodes` is a `Nodes`; `edges` is (E, 3):
# offset of the sender from the receiver (x, y) and its length, in world units; edge order is
# receiver-major without self edges; `globals` is None.
SceneGraph = jraph.GraphsTuple


class DemoBatch(NamedTuple):
    """Demonstrations of one object set, padded to a common length with their last frame."""

    center: Float[Array, "B T N 2"]  # world units
    size: Float[Array, "B T N 2"]
    label: Int[Array, "B N"]
    is_robot: Bool[Array, "B N"]
    present: Bool[Array, "B N"]
    length: Int[Array, "B"]  # frames before padding, at least 1


class VideoBatch(NamedTuple):
    """Videos of square frames, padded to a common length with their last frame."""

    frames: UInt8[Array, "B T P P 3"]  # RGB; x to the right, y upwards
    length: Int[Array, "B"]  # frames before padding, at least 1


def checked(function: _Function) -> _Function:
    """The function, with a ShapeError for an argument that is no array of its kind, and a
    ConfigError for one of another class.

    Lists become arrays, and None is refused where it means nothing. Shapes are the function's own
    to check. All is done once a trace, before anything is compiled.
    """
    signature = inspect.signature(function)
    said = {n: p for n, p in signature.parameters.items() if p.annotation is not p.empty}
    kinds = {n: _kinds(p.annotation) for n, p in said.items() if p.kind in _NAMED}

    @functools.wraps(function)
    def called(*args: Any, **options: Any) -> Any:
        given = signature.bind(*args, **options)
        for name in kinds.keys() & given.arguments.keys():
            given.arguments[name] = _taken(name, given.arguments[name], kinds[name])
        return function(*given.args, **given.kwargs)

    called.__wrapped__ = inspect.unwrap(function)
    return called


def _kinds(annotation: Any) -> tuple[Any, ...]:
    """The alternatives of an annotation."""
    if typing.get_origin(annotation) in (typing.Union, UnionType):
        return tuple(kind for one in typing.get_args(annotation) for kind in _kinds(one))
    return (annotation,)


def _taken(name: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    """The value as the function takes it."""
    tuples = [kind for kind in kinds if isinstance(kind, type) and hasattr(kind, "_fields")]
    arrays = [kind for kind in kinds if _DTYPES & {*getattr(kind, "dtypes", ())}]
    if value is None and NoneType in kinds:
        return value
    if isinstance(value, tuple(tuples)):
        return _fields(name, value)
    if not arrays:
        return _plain(name, value, kinds)
    if type(value) in kinds:  # a number, where one will do
        return value
    return _array(name, value, arrays[0].dtypes)


def _plain(name: str, value: Any, kinds: tuple[Any, ...]) -> Any:
    """A value of one of some classes; what else an annotation may say is not looked at."""
    classes = tuple(typing.get_origin(kind) or kind for kind in kinds)
    if Any in classes or not all(type(one) in (type, ABCMeta) for one in classes):
        return value
    if any(getattr(one, "_is_protocol", False) for one in classes) or isinstance(value, classes):
        return value
    number = {int: "__index__", float: "__float__"}
    if any(hasattr(value, number[one]) for one in number.keys() & {*classes}):
        return value
    words = " or ".join(one.__name__ for one in classes if one is not NoneType)
    raise ConfigError(f"{name} is {value!r:.60}, but must be a {words}")


def _fields(name: str, value: Any) -> Any:
    """A named tuple of ours whose arrays are arrays."""
    hints = inspect.get_annotations(type(value))
    found = {f: _taken(f"{name}.{f}", getattr(value, f), _kinds(hints.get(f))) for f in hints}
    return value._replace(**found)


def _array(name: str, value: Any, dtypes: tuple[str, ...]) -> Any:
    if isinstance(value, list | tuple | int | float):
        try:
            value = jnp.asarray(value)
        except (TypeError, ValueError):
            raise ShapeError(f"{name} is {value!r:.60}, but must be numbers of one shape") from None
    if not (hasattr(value, "dtype") and hasattr(value, "shape")):
        raise ShapeError(f"{name} is {value!r:.60}, but must be an array")
    if not {"float32", "int32"} & {*dtypes}:
        return value if value.dtype == bool else jnp.asarray(value) != 0
    real = jnp.issubdtype(value.dtype, jnp.floating)
    whole = jnp.issubdtype(value.dtype, jnp.integer) or value.dtype == bool
    if not (real or whole):
        raise ShapeError(f"{name} holds {value.dtype}, but must hold numbers")
    if real and "int32" in dtypes and "float32" not in dtypes:
        raise ShapeError(f"{name} holds {value.dtype}, but must hold whole numbers")
    return value
