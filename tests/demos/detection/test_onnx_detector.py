"""Detectors saved as ONNX: a small one that really finds the kitchen's things, written in each of
the kinds that exporters write, and run by OpenCV."""

import numpy as np
import pytest
from support import colour_network, kitchen_films
from support.colour_network import NAMES
from support.onnx_writer import network

from gril_jax.demos.detection.layouts import Layout, layout_of
from gril_jax.demos.detection.onnx_detector import fit, onnx_detector
from gril_jax.demos.detection.onnx_header import read_header
from gril_jax.demos.detection.sightings import best_of
from gril_jax.errors import DemoError

LOOK = {"fps": 10.0, "width": 320, "height": 240, "tempo": 2.0}
KINDS = {
    "end-to-end": "YOLO end-to-end", "YOLOv8": "YOLOv8", "YOLOv5": "YOLOv5", "YOLOX": "YOLOX",
    "YOLOX in cells": "YOLOX", "RF-DETR": "RF-DETR",
}  # fmt: skip


@pytest.fixture(scope="module")
def shown():
    """Three frames of a video without the hand over a thing, and the true boxes in these."""
    told = kitchen_films.story(3, **LOOK)
    frames = [*kitchen_films.painted(told, 3)]
    picks = [0, 1, 2]
    return np.stack([frames[t] for t in picks]), told.boxes[picks]


def written(folder, data, names=NAMES):
    (folder / "model.onnx").write_bytes(data)
    (folder / "names.txt").write_text("\n".join(names) + "\n")
    return folder / "model.onnx", folder / "names.txt"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(256, 320), (192, 256)])
def test_each_kind_of_export_finds_what_is_there(tmp_path, shown, kind, size):
    frames, true = shown
    found = onnx_detector(*written(tmp_path, colour_network.detector(*size, kind)))
    assert (found.layout.name, found.size) == (KINDS[kind], size)
    for sightings, boxes in zip(found(frames), true, strict=True):
        for number, name in enumerate(("cup", "coaster")):
            (own,) = [one for one in sightings if one.name == name]
            assert own.score > 0.5
            np.testing.assert_allclose(own.edges, boxes[number], atol=4.0)


def test_a_frame_of_another_shape_lies_whole_in_the_input_and_boxes_are_put_back(tmp_path, shown):
    """A letterbox has grey above or beside; stretching has not. Either is undone."""
    frames, true = shown
    for kind in ("YOLOv8", "YOLOX", "RF-DETR"):
        found = onnx_detector(*written(tmp_path, colour_network.detector(320, 320, kind)))
        (cup,) = [one for one in found(frames[:1])[0] if one.name == "cup"]
        np.testing.assert_allclose(cup.edges, true[0, 0], atol=4.0)


def test_names_may_be_in_the_file_and_any_size_is_640(tmp_path, shown):
    frames, true = shown
    data = colour_network.detector(640, 640, "YOLOv8", free=True, note=True)
    path, _ = written(tmp_path, data)
    assert read_header(path) == ((1, 3, None, None), [*NAMES])
    found = onnx_detector(path, None)
    assert (found.size, found.names) == ((640, 640), [*NAMES])
    (cup,) = [one for one in found(frames[:1])[0] if one.name == "cup"]
    np.testing.assert_allclose(cup.edges, true[0, 0], atol=4.0)


def test_a_picture_in_the_middle_a_corner_or_stretched():
    frame = np.full((2, 4, 3), [255, 0, 51], np.uint8)
    middle = fit(frame, (8, 8), Layout("", None, 0))
    assert (middle.scale, middle.shift) == ((2.0, 2.0), (0, 2))
    np.testing.assert_allclose(middle.values[0, :, 3, 0], [1.0, 0.0, 0.2], atol=1e-6)
    np.testing.assert_allclose(middle.values[0, :, 0, 0], 114 / 255, atol=1e-6)
    corner = fit(frame, (8, 8), Layout("", None, 0, "corner", deviation=(1 / 255,) * 3, rgb=False))
    assert corner.shift == (0, 0)
    np.testing.assert_allclose(corner.values[0, :, 0, 0], [51, 0, 255], atol=1e-4)
    np.testing.assert_allclose(corner.values[0, :, 7, 0], 114, atol=1e-4)
    stretched = fit(frame, (8, 8), Layout("", None, 0, "stretched", mean=(1, 0, 0)))
    assert (stretched.scale, stretched.shift) == ((2.0, 4.0), (0, 0))
    np.testing.assert_allclose(stretched.values[0, 0], 0.0, atol=1e-6)


def test_cells_of_yolox_are_rows_and_columns_from_small_to_large():
    """Boxes in cells, of a middle at 0.5 and sides of one cell: the cells themselves."""
    found = np.zeros((8 * 4 + 4 * 2 + 2 * 1, 6))
    found[:, :2], found[:, 4:] = 0.5, 1.0
    layout = layout_of([found.shape], (32, 64))
    edges, scores = layout.decode([found], (32, 64))
    assert edges[9].tolist() == [8, 8, 16, 16]
    assert edges[32].tolist() == [0, 0, 16, 16]
    assert edges[-1].tolist() == [32, 0, 64, 32]
    assert scores.shape == (42, 1)


def test_second_boxes_of_one_object_are_left_out():
    scores = np.array([[0.9], [0.8]])
    near = np.array([[0, 0, 10, 10], [1, 0, 11, 10]], float)
    far = np.array([[0, 0, 10, 10], [6, 0, 16, 10]], float)
    assert len(best_of(near, scores, ["cup"], 99, 99)) == 1
    assert len(best_of(far, scores, ["cup"], 99, 99)) == 2
    both = np.array([[0.9, 0.0], [0.0, 0.8]])
    assert len(best_of(near, both, ["cup", "mug"], 99, 99)) == 2


def _constant(shape, inputs=None):
    """A network whose output has a shape, whatever it is shown."""
    nodes = [
        ("ReduceMean", ["images"], ["mean"], {"axes": [1, 2, 3], "keepdims": 0}),
        ("Mul", ["mean", "zero"], ["nothing"], {}),
        ("Add", ["nothing", "fixed"], ["output0"], {}),
    ]
    tensors = {"zero": np.float32([0]), "fixed": np.full(shape, 0.25, np.float32)}
    return network(nodes, tensors, inputs or {"images": (1, 3, 64, 64)}, {"output0": shape})


WRONG = {
    "another output": (_constant((1, 7, 7)), NAMES, "its outputs are 1 x 7 x 7 for pictures of"),
    "a sixth column that is no class": (_constant((1, 30, 6)), NAMES, "are 1 x 30 x 6 for pictu"),
    "a classifier": (_constant((1, 10)), NAMES, "its outputs are 1 x 1 x 10"),
    "sound": (_constant((1, 6), {"images": (1, 80, 3000)}), NAMES, "its input is 1 x 80 x 3000"),
    "no ONNX": (b"PK\x03\x04" * 40, NAMES, "is not an ONNX file, or is damaged"),
    "nothing": (b"", NAMES, "is not an ONNX file, or is damaged"),
    "cut short": (colour_network.detector(64, 64)[:900], NAMES, "damaged"),
    "too few names": (
        colour_network.detector(64, 64, "YOLOv8"), NAMES[:3], "has 3 names, but model.onnx tells 4"
    ),
    "the same name twice": (colour_network.detector(64, 64), ("cup", "cup"), "'cup' stands in li"),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_file_is_one_sentence(tmp_path, capfd, kind):
    data, names, words = WRONG[kind]
    with pytest.raises(DemoError) as raised:
        onnx_detector(*written(tmp_path, data, names))
    said = str(raised.value)
    assert words in said, said
    assert "\n" not in said
    assert len(said) < 600
    assert capfd.readouterr().err == ""


def test_names_must_be_somewhere_and_the_file_must_exist(tmp_path):
    path, names = written(tmp_path, colour_network.detector(64, 64))
    with pytest.raises(DemoError, match="has no names of its classes; give a text with one"):
        onnx_detector(path, None)
    with pytest.raises(DemoError, match=r"none.onnx: the model cannot be read \(No such file"):
        onnx_detector(tmp_path / "none.onnx", names)
