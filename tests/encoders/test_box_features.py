"""GraphIRL's node features against a loop."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.graph_frames import NUM_CLASSES, random_frame

from gril_jax.encoders.box_features import class_distances, history_features, last_frame
from gril_jax.encoders.box_mlp import MLPConfig
from gril_jax.errors import ShapeError
from gril_jax.graphs.scene import scene_graph


def _nearest(center, label, counted, i, kind):
    found = [
        np.linalg.norm(center[i] - center[j])
        for j in range(len(label))
        if label[j] == kind and (counted[j] or j == i)
    ]
    return min(found, default=0.0)


@pytest.mark.parametrize("num_nodes", [0, 1, 7])
def test_distances_are_those_to_the_nearest_counted_object_of_each_class(num_nodes):
    frame = random_frame(1, num_nodes)
    counted = jnp.arange(num_nodes) % 3 != 0
    got = class_distances(frame["center"], frame["label"], counted, NUM_CLASSES)
    center, label = np.asarray(frame["center"], np.float64), np.asarray(frame["label"])
    wanted = [
        [_nearest(center, label, counted, i, kind) for kind in range(NUM_CLASSES)]
        for i in range(num_nodes)
    ]
    np.testing.assert_allclose(got, np.reshape(wanted, (-1, NUM_CLASSES)), rtol=1e-6)


def test_one_object_of_each_class_in_order_gives_the_distance_matrix():
    center = random_frame(2, 3)["center"]
    got = class_distances(center, jnp.arange(3), jnp.ones(3, bool), 3)
    wanted = np.linalg.norm(np.asarray(center)[:, None] - np.asarray(center), axis=-1)
    np.testing.assert_allclose(got, wanted, rtol=1e-6)


def test_gradient_of_distances_is_finite_where_centres_coincide():
    label = jnp.array([0, 1, 1])
    gradient = jax.grad(lambda c: class_distances(c, label, label > 0, 3).sum())(jnp.ones((3, 2)))
    assert np.isfinite(gradient).all()


def test_history_is_the_frames_side_by_side_and_an_absent_object_gives_zeros():
    frames = [random_frame(seed) for seed in (3, 4)]
    config = MLPConfig(NUM_CLASSES, distances=True, length_unit=2.0)
    nodes = [scene_graph(**f).nodes for f in frames]
    each = [history_features(n, config, robot=True) for n in nodes]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *nodes)
    both = history_features(stacked, dataclasses.replace(config, history=2), robot=True)
    np.testing.assert_array_equal(both, jnp.concatenate(each, axis=-1))
    assert (both[4] == 0).all()
    corner = (frames[0]["center"] - frames[0]["size"] / 2) / 2.0
    np.testing.assert_allclose(both[:4, :2], corner[:4], rtol=1e-6)
    np.testing.assert_array_equal(last_frame(stacked, history=2).center, frames[1]["center"])


def test_another_number_of_frames_is_refused_with_both():
    nodes = scene_graph(**random_frame()).nodes
    stacked = jax.tree.map(lambda x: jnp.stack([x] * 3), nodes)
    for given, history, shape in ((nodes, 2, "(2, N, 2)"), (stacked, 2, "(2, N, 2)"),
                                  (stacked, 1, "(N, 2)")):  # fmt: skip
        with pytest.raises(ShapeError) as error:
            last_frame(given, history=history)
        assert f"encoder.history is {history}; its shape must be {shape}." in str(error.value)
        assert str(given.center.shape) in str(error.value)
