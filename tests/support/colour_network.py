"""A detector as a network: it finds the things of the kitchen by their colours.

A point is of a class where its smoothed colour is near the class's in all of a few mixtures of red,
green and blue. A class's box spans the rows and columns that have several such points. The last
step writes boxes and scores as one kind of exported detector does.
"""

import numpy as np

from .onnx_writer import network

NAMES = ("cup", "coaster", "spoon", "hand")
# Of each class: mixtures of red, green and blue from 0 to 255, and their least values.
_MIXTURES = {
    "cup": [((-1, 0, 1), 56), ((0, -1, 1), 44), ((-1, 0, 0), -85)],
    "coaster": [((-1, 1, 0), 26), ((0, 1, -1), 20), ((-1, 0, 0), -76)],
    "spoon": [((1, 0, 0), 172), ((0, 1, 0), 172), ((0, 0, 1), 178)],
    "hand": [((1, 0, -1), 48), ((1, -1, 0), 28), ((1, 0, 0), 175)],
}
_STEEP = 0.5  # of a point's score, for one of 255
_POINTS = {"cup": 7, "coaster": 8, "spoon": 4, "hand": 8}  # in its rows and columns, at least
STRIDES = (8, 16, 32)


def detector(height, width, kind="end-to-end", *, names=NAMES, free=False, note=False):
    """The bytes of a network for RGB pictures of a height and width."""
    unit = 1.0 if kind.startswith("YOLOX") else 255.0
    shift, deviation = np.zeros(3), np.ones(3)
    if kind == "RF-DETR":
        shift, deviation = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    nodes, tensors = [], {}

    def add(operation, inputs, output, **attributes):
        nodes.append((operation, inputs, [output], attributes))
        return output

    def fixed(name, value):
        tensors[name] = np.asarray(value)
        return name

    picture = add(
        "AveragePool", ["images"], "smooth", kernel_shape=[3, 3], strides=[1, 1], pads=[1, 1, 1, 1]
    )
    maps = []
    for name in names:
        weights, least = zip(*_MIXTURES[name], strict=True)
        weights = np.array(weights, float)
        bias = (weights @ shift * 255.0 - np.array(least)) * _STEEP
        weights = weights * deviation * unit * _STEEP
        if kind.startswith("YOLOX"):
            weights = weights[:, ::-1]
        fixed(f"w {name}", np.float32(weights)[..., None, None])
        fixed(f"b {name}", np.float32(bias))
        over = add("Conv", [picture, f"w {name}", f"b {name}"], f"over {name}", kernel_shape=[1, 1])
        maps.append(add("ReduceMin", [over], f"all {name}", axes=[1], keepdims=1))
    fixed("none", np.float32(0)), fixed("one", np.float32(1))
    fixed("points", np.float32([[[_POINTS[name]] for name in names]]))
    points = add("Clip", [add("Concat", maps, "maps", axis=1), "none", "one"], "mask")
    edges = {}
    for letter, side, axis in (("x", width, 2), ("y", height, 3)):
        count = add("ReduceSum", [points], f"count {letter}", axes=[axis], keepdims=0)
        over = add("Sub", [count, "points"], f"many {letter}")
        on = add("Clip", [over, "none", "one"], f"on {letter}")
        ramp = np.arange(1, side + 1, dtype=np.float32)
        high = add("Mul", [on, fixed(f"ramp {letter}", ramp)], f"up {letter}")
        low = add("Mul", [on, fixed(f"fall {letter}", ramp[::-1].copy())], f"down {letter}")
        edges[f"high {letter}"] = add("ReduceMax", [high], f"high {letter}", axes=[2], keepdims=1)
        far = add("ReduceMax", [low], f"far {letter}", axes=[2], keepdims=1)
        edges[f"low {letter}"] = add(
            "Sub", [fixed(f"side {letter}", np.float32(side)), far], f"low {letter}"
        )
        edges[f"sure {letter}"] = add("ReduceMax", [on], f"sure {letter}", axes=[2], keepdims=1)
    sure = add("Mul", [edges["sure x"], edges["sure y"]], "sure")
    edges = ["low x", "low y", "high x", "high y"]
    outputs = _written(kind, add, fixed, edges, sure, len(names), height, width)
    shape = (1, 3, "height", "width") if free else (1, 3, height, width)
    notes = {"names": repr(dict(enumerate(names)))} if note else None
    return network(nodes, tensors, {"images": shape}, outputs, notes)


def _written(kind, add, fixed, edges, sure, count, height, width):
    """The last nodes, which write 1 x C x 1 edges and scores as a kind does; the outputs."""
    number = np.arange(count, dtype=np.float32)[None, :, None]
    if kind == "end-to-end":
        add("Concat", [*edges, sure, fixed("number", number)], "output0", axis=2)
        return {"output0": (1, count, 6)}
    low, high = add("Concat", edges[:2], "low", axis=2), add("Concat", edges[2:], "high", axis=2)
    half = fixed("half", np.float32(0.5))
    middle = add("Mul", [add("Add", [low, high], "sum"), half], "middle")
    sides = add("Sub", [high, low], "sides")
    scores = add("Mul", [sure, fixed("eye", np.eye(count, dtype=np.float32)[None])], "each")
    if kind == "RF-DETR":
        picture = fixed("picture", np.float32([width, height] * 2))
        add("Div", [add("Concat", [middle, sides], "pixels", axis=2), picture], "dets")
        steep, less = fixed("steep", np.float32(20)), fixed("less", np.float32(10))
        add("Sub", [add("Mul", [scores, steep], "steeper"), less], "labels")
        return {"dets": (1, count, 4), "labels": (1, count, count)}
    if kind == "YOLOX in cells":  # of the first row, whose cells have 8 pixels
        column = np.stack([np.arange(count), np.zeros(count)], axis=-1)[None]
        eight = fixed("eight", np.float32(STRIDES[0]))
        off = add("Div", [middle, eight], "in cells")
        middle = add("Sub", [off, fixed("cells", np.float32(column))], "beside")
        small = add("Max", [sides, fixed("tiny", np.float32(1e-3))], "some")
        sides = add("Log", [add("Div", [small, eight], "sides in cells")], "logs")
    parts = [middle, sides]
    if kind != "YOLOv8":
        parts.append(fixed("present", np.ones((1, count, 1), np.float32)))
    rows = add("Concat", [*parts, scores], "rows", axis=2)
    cells = sum((height // side) * (width // side) for side in STRIDES)
    total = 3 * cells if kind == "YOLOv5" else cells
    # Decoded boxes lie all over the picture; what is empty has no score.
    columns = 4 + count + (kind != "YOLOv8")
    empty = np.zeros((1, total - count, columns), np.float32)
    if kind != "YOLOX in cells":
        empty[..., :2] = [width / 2, height / 2]
    whole = add("Concat", [rows, fixed("empty", empty)], "whole", axis=1)
    if kind == "YOLOv8":
        add("Transpose", [whole], "output0", perm=[0, 2, 1])
        return {"output0": (1, columns, total)}
    add("Identity", [whole], "output0")
    return {"output0": (1, total, columns)}
