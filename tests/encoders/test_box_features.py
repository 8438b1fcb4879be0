"""GraphIRL's node features against a loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.graph_frames import NUM_CLASSES, random_frame

from gril_jax.encoders.box_mlp import box_features, class_distances
from gril_jax.encoders.encoder import InteractionConfig
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


def test_features_are_corners_then_distances_in_length_units_and_an_absent_object_has_none():
    frame, config = random_frame(3), InteractionConfig(NUM_CLASSES, distances=True, length_unit=2.0)
    found = box_features(scene_graph(**frame).nodes, config, robot=True)
    assert found.shape == (5, 4 + NUM_CLASSES)
    corner = (frame["center"] - frame["size"] / 2) / 2.0
    np.testing.assert_allclose(found[:4, :2], corner[:4], rtol=1e-6)
    apart = class_distances(frame["center"], frame["label"], frame["present"], NUM_CLASSES) / 2.0
    np.testing.assert_allclose(found[:4, 4:], apart[:4], rtol=1e-6)
    assert (found[4] == 0).all()
