"""Scene graphs against a plain double loop, and the gradient where two centres coincide."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gril_jax
from gril_jax.cli import main
from gril_jax.demos.vision.video import write_video
from gril_jax.errors import ConfigError, ShapeError
from gril_jax.graphs import boxes_from_pixels
from gril_jax.graphs.scene import edge_indices, safe_norm, scene_graph


def _frame(num_nodes, seed=0):
    rng = np.random.default_rng(seed)
    return (
        jnp.asarray(rng.normal(size=(num_nodes, 2)), jnp.float32),
        jnp.asarray(rng.uniform(0.1, 1, (num_nodes, 2)), jnp.float32),
        jnp.arange(num_nodes),
        jnp.arange(num_nodes) == 1,
        jnp.arange(num_nodes) == 2,
    )


@pytest.mark.parametrize("num_nodes", [1, 2, 5])
def test_edges_are_receiver_major_without_self_edges(num_nodes):
    pairs = [(s, r) for r in range(num_nodes) for s in range(num_nodes) if s != r]
    senders, receivers = edge_indices(num_nodes)
    assert list(zip(senders.tolist(), receivers.tolist(), strict=True)) == pairs


def test_edge_features_are_offset_from_receiver_to_sender_and_its_length():
    frame = _frame(4)
    graph = scene_graph(*frame)
    center = np.asarray(frame[0], np.float64)
    expected = []
    for receiver in range(4):
        for sender in range(4):
            if sender != receiver:
                x, y = center[sender] - center[receiver]
                expected.append([x, y, (x * x + y * y) ** 0.5])
    np.testing.assert_allclose(graph.edges, expected, rtol=1e-6)
    assert graph.n_node.tolist() == [4]
    assert graph.n_edge.tolist() == [12]


def test_nodes_carry_the_frame_and_all_are_present_by_default():
    frame = _frame(3)
    nodes = scene_graph(*frame).nodes
    for field, value in zip(("center", "size", "label", "is_robot", "active"), frame, strict=True):
        np.testing.assert_array_equal(getattr(nodes, field), value)
    assert nodes.present.tolist() == [True] * 3
    gone = frame[1].at[1].set(0.0)  # a box without a size
    assert scene_graph(frame[0], gone, *frame[2:]).nodes.present.tolist() == [True, False, True]
    present = jnp.array([True, False, True])
    assert scene_graph(*frame, present).nodes.present.tolist() == present.tolist()


def test_one_object_makes_a_graph_without_edges():
    graph = scene_graph(*_frame(1))
    assert graph.edges.shape == (0, 3)
    assert graph.senders.shape == (0,)


def test_gradient_of_distance_is_finite_where_centres_coincide():
    center, *rest = _frame(3)
    center = center.at[1].set(center[0])
    gradient = jax.grad(lambda c: scene_graph(c, *rest).edges.sum())(center)
    assert np.isfinite(gradient).all()


def test_safe_norm_is_the_norm_and_has_its_gradient_away_from_zero():
    x = jnp.array([[3.0, 4.0], [0.0, 0.0], [1e-8, 0.0]])
    np.testing.assert_allclose(safe_norm(x), [5.0, 0.0, 1e-8], rtol=1e-6)
    gradient = jax.grad(lambda x: safe_norm(x).sum())(x)
    np.testing.assert_allclose(gradient, [[0.6, 0.8], [0.0, 0.0], [1.0, 0.0]], rtol=1e-6)


def test_vmap_equals_a_loop_and_jit_equals_plain():
    frames = [_frame(4, seed) for seed in range(3)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *frames)
    batched = jax.jit(jax.vmap(scene_graph))(*batch)
    for i, frame in enumerate(frames):
        np.testing.assert_allclose(batched.edges[i], scene_graph(*frame).edges, rtol=1e-6)


def test_the_length_of_a_vector_with_nan_is_nan():
    """Were it 0, a broken encoder would be paid as if at the goal."""
    found = np.asarray(safe_norm(jnp.array([[jnp.nan, 0.0], [3.0, 4.0]])))
    assert np.isnan(found[0])
    assert found[1] == 5.0


WIDTH, HEIGHT = 64, 48
numbers = st.floats(-1e4, 1e4, width=32)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(numbers, numbers, numbers, numbers), min_size=1, max_size=4))
def test_every_box_equals_plain_arithmetic(boxes):
    for unit in (0.5, 1.1):
        center, size = boxes_from_pixels(np.array(boxes), WIDTH, HEIGHT, half_extent=unit)
        for (x0, y0, x1, y1), c, s in zip(boxes, center, size, strict=True):
            scale = 2 * unit / WIDTH
            middle = ((x0 + x1) / 2 - WIDTH / 2) * scale, (HEIGHT / 2 - (y0 + y1) / 2) * scale
            np.testing.assert_allclose(c, middle, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(
                s, ((x1 - x0) * scale, (y1 - y0) * scale), rtol=1e-6, atol=1e-30
            )


def test_arrays_of_jax_are_traced_and_lost_boxes_stay_lost():
    boxes = jnp.array([[[0.0, 0.0, 32.0, 24.0], [1.0, jnp.nan, 2.0, 3.0]]] * 3)
    center, size = jax.jit(jax.vmap(lambda b: boxes_from_pixels(b, WIDTH, HEIGHT)))(boxes)
    assert center.shape == size.shape == (3, 2, 2)
    assert center[0, 0].tolist() == [-0.25, 0.1875]
    assert jnp.isnan(center[:, 1, 1]).all()
    assert center.dtype == size.dtype == jnp.float32


def test_numbers_are_those_of_an_imported_set_bit_for_bit(tmp_path):
    """Of a video with boxes beside it, in widths of the picture and in a unit of one's own."""
    frames, names = 12, ("cup", "plate")
    low = np.array([[3.0, 5.0], [40.0, 20.0]]) + np.arange(frames)[:, None, None] * [1.37, 0.61]
    boxes = np.concatenate([low, low + [[9.5, 11.25], [14.0, 8.125]]], axis=-1).round(3)
    films = tmp_path / "films"
    films.mkdir()
    write_video(films / "a.mp4", np.zeros((frames, HEIGHT, WIDTH, 3), np.uint8), 10.0)
    rows = ["frame,class,x_min,y_min,x_max,y_max"]
    for t in range(frames):
        rows += [f"{t},{n},{','.join(map(str, b))}" for n, b in zip(names, boxes[t], strict=True)]
    (films / "a.csv").write_text("\n".join(rows))
    for unit, options in ((0.5, ()), (1.3, ("--half-extent", "1.3"))):
        out = tmp_path / str(unit)
        verb = ["demos", "import-videos", str(films), "--boxes", "auto", "--out", str(out)]
        assert main.main([*verb, "--jitter", "0", *options]) == 0
        imported = gril_jax.load_demos(out)
        assert imported.half_extent == unit
        (tracks,) = (demo.tracks for demo in imported)
        center, size = boxes_from_pixels(boxes, WIDTH, HEIGHT, half_extent=unit)
        kept = len(tracks.center)
        for number, name in enumerate(names):
            at = [imported.classes[label] for label in tracks.label].index(name)
            np.testing.assert_array_equal(tracks.center[:, at], center[:kept, number])
            np.testing.assert_array_equal(tracks.size[:, at], size[:kept, number])


@pytest.mark.parametrize(
    ("boxes", "width", "unit", "kind", "text"),
    [
        (np.zeros((2, 3)), 64, 0.5, ShapeError, r"shape \(2, 3\); its last axis must be x0"),
        (np.zeros((2, 4)), 0, 0.5, ConfigError, "width is 0; it must be positive"),
        (np.zeros((2, 4)), 64, float("nan"), ConfigError, "half_extent is nan"),
    ],
)
def test_what_does_not_fit_is_refused(boxes, width, unit, kind, text):
    with pytest.raises(kind, match=text):
        boxes_from_pixels.__wrapped__(boxes, width, 48, half_extent=unit)
