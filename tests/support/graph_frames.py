"""Frames of boxes for the encoders' tests: random ones, and the awkward ones hypothesis makes."""

import jax.numpy as jnp
import numpy as np
from hypothesis import strategies as st

NUM_CLASSES = 4


def random_frame(seed=0, num_nodes=5, *, robot=1, absent=4):
    """Arguments of `scene_graph`; a repeated class, a robot, and a node that is not present."""
    rng = np.random.default_rng(seed)
    return {
        "center": jnp.asarray(rng.normal(size=(num_nodes, 2)), jnp.float32),
        "size": jnp.asarray(rng.uniform(0.1, 1, (num_nodes, 2)), jnp.float32),
        "label": jnp.asarray(rng.integers(0, NUM_CLASSES, num_nodes), jnp.int32),
        "is_robot": jnp.asarray(np.arange(num_nodes) == robot),
        "active": jnp.asarray(rng.random(num_nodes) < 0.5),
        "present": jnp.asarray(np.arange(num_nodes) != absent),
    }


def awkward_frames(num_nodes):
    """Frames of a given size: equal boxes, robots only, padding only, boxes far or of no size."""
    flags = st.lists(st.booleans(), min_size=num_nodes, max_size=num_nodes)
    flags = st.one_of(st.just([False] * num_nodes), st.just([True] * num_nodes), flags)
    number = st.sampled_from([0.0, 0.5, 0.5, -1.0, 1e-20, 1e6])
    pairs = st.lists(st.tuples(number, number), min_size=num_nodes, max_size=num_nodes)
    labels = st.lists(st.integers(0, NUM_CLASSES - 1), min_size=num_nodes, max_size=num_nodes)
    return st.builds(
        lambda center, size, label, robot, active, present: {
            "center": jnp.asarray(center, jnp.float32).reshape(num_nodes, 2),
            "size": jnp.asarray(size, jnp.float32).reshape(num_nodes, 2),
            "label": jnp.asarray(label, jnp.int32),
            "is_robot": jnp.asarray(robot, bool),
            "active": jnp.asarray(active, bool),
            "present": jnp.asarray(present, bool),
        },
        pairs, pairs, labels, flags, flags, flags,
    )  # fmt: skip
