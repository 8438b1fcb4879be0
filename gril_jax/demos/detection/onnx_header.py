"""What an ONNX file says of itself: the size of its input, and names of classes if it has them.

OpenCV runs the network but does not tell the size of its input. The file is in Protocol Buffers,
of which three messages are read here; weights are passed over.
"""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from gril_jax.errors import DemoError

# Numbers of fields in onnx.proto: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto
_MODEL_GRAPH, _MODEL_NOTES = 7, 14
_GRAPH_WEIGHTS, _GRAPH_INPUT = 5, 11
_WEIGHTS_NAME = 8
_NUMBER, _EIGHT, _BYTES, _FOUR = 0, 1, 2, 5  # kinds of a field's value
_LARGEST = 1 << 31  # bytes: a message of Protocol Buffers can be no longer
_MOST_BITS = 70  # of a number in parts of seven


class Header(NamedTuple):
    """The input of a network, and the names of its classes."""

    input: tuple[int | None, ...]  # batch, channels, height, width; None where any is taken
    names: list[str] | None  # as the exporter of YOLO notes them


def read_header(path: Path) -> Header:
    """The header of a file; a DemoError if it is no ONNX file of one input."""
    try:
        if path.stat().st_size >= _LARGEST:
            raise DemoError(f"{path}: is larger than 2 GiB, which no ONNX file is.")
        found = _model(memoryview(path.read_bytes()))
    except OSError as error:
        raise DemoError(f"{path}: the model cannot be read ({error.strerror}).") from None
    except (ValueError, IndexError):
        raise DemoError(f"{path}: is not an ONNX file, or is damaged.") from None
    if len(found.input) != 4 or found.input[1] not in (3, None):
        shape = " x ".join("any" if side is None else str(side) for side in found.input)
        raise DemoError(
            f"{path}: its input is {shape or 'missing'}, but a detector takes pictures: 1 x 3 x "
            "height x width."
        )
    return found


def _model(data: memoryview) -> Header:
    shapes, weights, names = {}, set(), None
    graphs = [value for number, value in _fields(data) if number == _MODEL_GRAPH]
    for number, value in _fields(graphs[0]):
        if number == _GRAPH_INPUT:
            about = _message(value)
            shapes[_text(about[1])] = _shape(about[2])
        elif number == _GRAPH_WEIGHTS:
            weights.add(_text(_message(value)[_WEIGHTS_NAME]))
    for number, value in _fields(data):
        note = _message(value) if number == _MODEL_NOTES else {}
        if 1 in note and 2 in note and _text(note[1]) == "names":
            names = _names(_text(note[2]))
    inputs = [shape for name, shape in shapes.items() if name not in weights]
    return Header(inputs[0] if len(inputs) == 1 else (), names)


def _shape(kind: memoryview) -> tuple[int | None, ...]:
    """The sides of a tensor: TypeProto, its tensor_type, the shape of that, and dim_value."""
    tensor = _message(_message(kind)[1])
    sides = [_message(value) for number, value in _fields(tensor[2]) if number == 1]
    return tuple(side[1] if isinstance(side.get(1), int) and side[1] > 0 else None
                 for side in sides)  # fmt: skip


def _names(text: str) -> list[str] | None:
    """The names of classes as the exporter of YOLO notes them: {0: 'person', 1: 'bicycle'}."""
    try:
        found = ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None
    listed = isinstance(found, dict) and [*found] == [*range(len(found))]
    return [str(name) for name in found.values()] if listed else None


def _message(data: memoryview) -> dict[int, int | memoryview]:
    """The fields of a message by their numbers; of one that comes twice the last."""
    return dict(_fields(data))


def _fields(data: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """The numbers and values of a message's fields, in order."""
    at = 0
    while at < len(data):
        key, at = _number(data, at)
        kind = key & 7
        if kind == _NUMBER:
            value, at = _number(data, at)
        elif kind in (_EIGHT, _FOUR):
            size = 8 if kind == _EIGHT else 4
            value, at = data[at : at + size], at + size
        elif kind == _BYTES:
            size, at = _number(data, at)
            value, at = data[at : at + size], at + size
        else:
            raise ValueError(kind)
        if at > len(data):
            raise ValueError(at)
        yield key >> 3, value


def _number(data: memoryview, at: int) -> tuple[int, int]:
    """A number in parts of seven bits, and where it ends."""
    found = 0
    for shift in range(0, _MOST_BITS, 7):
        part = data[at]
        found, at = found | (part & 127) << shift, at + 1
        if part < 128:
            return found, at
    raise ValueError(found)


def _text(data: memoryview) -> str:
    return bytes(data).decode()
