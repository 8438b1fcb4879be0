"""Writes small ONNX files, of the fields of onnx.proto that a network needs."""

import numpy as np

_OPSET = 11
_FLOAT, _INT64 = 1, 7  # kinds of a tensor


def network(nodes, tensors, inputs, outputs, notes=None):
    """The bytes of a model.

    nodes: (operation, inputs, outputs, attributes); tensors: arrays by name; inputs and outputs:
    shapes by name, with a word for a side that may be any; notes: texts by name.
    """
    graph = b"".join(_bytes(1, _node(*node)) for node in nodes) + _bytes(2, b"made")
    graph += b"".join(_bytes(5, _tensor(name, value)) for name, value in tensors.items())
    graph += b"".join(_bytes(11, _value(name, shape)) for name, shape in inputs.items())
    graph += b"".join(_bytes(12, _value(name, shape)) for name, shape in outputs.items())
    made = _number(1, 8) + _bytes(7, graph) + _bytes(8, _bytes(1, b"") + _number(2, _OPSET))
    for name, text in (notes or {}).items():
        made += _bytes(14, _bytes(1, name.encode()) + _bytes(2, text.encode()))
    return made


def _node(operation, inputs, outputs, attributes):
    made = b"".join(_bytes(1, name.encode()) for name in inputs)
    made += b"".join(_bytes(2, name.encode()) for name in outputs)
    made += _bytes(3, outputs[0].encode()) + _bytes(4, operation.encode())
    return made + b"".join(_bytes(5, _attribute(*one)) for one in attributes.items())


def _attribute(name, value):
    """A whole number, or a list of them."""
    made = _bytes(1, name.encode())
    if isinstance(value, int):
        return made + _number(3, value) + _number(20, 2)
    return made + b"".join(_number(8, one) for one in value) + _number(20, 7)


def _tensor(name, value):
    kind = _FLOAT if np.asarray(value).dtype.kind == "f" else _INT64
    value = np.asarray(value, np.float32 if kind == _FLOAT else np.int64)
    made = b"".join(_number(1, side) for side in value.shape) + _number(2, kind)
    return made + _bytes(8, name.encode()) + _bytes(9, value.tobytes())


def _value(name, shape):
    sides = b"".join(
        _bytes(1, _bytes(2, side.encode()) if isinstance(side, str) else _number(1, side))
        for side in shape
    )
    tensor = _number(1, _FLOAT) + _bytes(2, sides)
    return _bytes(1, name.encode()) + _bytes(2, _bytes(1, tensor))


def _number(field, value):
    return _varint(field << 3) + _varint(value)


def _bytes(field, value):
    return _varint(field << 3 | 2) + _varint(len(value)) + value


def _varint(value):
    value, made = value & (1 << 64) - 1, b""
    while value > 127:
        made, value = made + bytes([value & 127 | 128]), value >> 7
    return made + bytes([value])
