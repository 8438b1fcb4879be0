"""Features of a scene graph that the paper's encoder reads: of nodes, of edges and of all pairs.

`config` is an `EncoderConfig`, of which these functions know the options alone. Lengths are in its
`length_unit`. Shapes use N for nodes, E for edges, F for features and S for statistics.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from gril_jax.graphs.pair_statistics import pair_statistics
from gril_jax.types import Nodes, SceneGraph

EDGE = 0.3  # halves of the smaller side of a box, on each side of an edge: about two pixels


def of_nodes(nodes: Nodes, config: Any) -> Float[Array, "N F"]:
    """One-hot class (without `words`), centre and size."""
    boxes = [box / config.length_unit for box in (nodes.center, nodes.size)]
    kinds = [] if config.words else [jax.nn.one_hot(nodes.label, config.num_classes)]
    return jnp.concatenate([*kinds, *boxes], axis=-1)


def of_edges(graph: SceneGraph, config: Any) -> Float[Array, "E F"]:
    """Offset and distance; with `relations` and `words` those of the boxes and the class names."""
    edges = graph.edges
    if config.relations:
        edges = jnp.concatenate([edges, relations(graph)], axis=-1)
    edges = edges / config.length_unit
    if config.relations:
        edges = jnp.concatenate([edges, side_of_edge(graph)], axis=-1)
    if config.words:
        edges = jnp.concatenate([edges, alike(graph, config)], axis=-1)
    return edges


def relations(graph: SceneGraph) -> Float[Array, "E 4"]:
    """For each edge, along x and y: how far the receiver's box sticks out of the sender's, and how
    far the two boxes are apart; 0 where it lies inside, or where they overlap."""
    half = graph.nodes.size / 2
    sender, receiver = half[graph.senders], half[graph.receivers]
    away = jnp.abs(graph.edges[:, :2])
    return jax.nn.relu(jnp.concatenate([away + receiver - sender, away - receiver - sender], -1))


def side_of_edge(graph: SceneGraph) -> Float[Array, "E 1"]:
    """For each edge, from -1 where the receiver's centre is well inside the sender's box to 1 where
    it is well outside.

    It changes within half the receiver's box. A reward that falls at an edge needs such a step,
    which a network makes of lengths only with large weights.
    """
    size = graph.nodes.size
    beyond = (jnp.abs(graph.edges[:, :2]) - size[graph.senders] / 2).max(axis=-1, keepdims=True)
    half = size[graph.receivers].min(axis=-1, keepdims=True) / 2
    return jnp.tanh(beyond / jnp.maximum(2 * EDGE * half, 1e-3))


def alike(graph: SceneGraph, config: Any) -> Float[Array, "E 2"]:
    """For each edge, 1 where the classes' names share their first word, and their last one."""
    words = jnp.array(config.words).reshape(-1, 2)[graph.nodes.label]
    return (words[graph.senders] == words[graph.receivers]).astype(jnp.float32)


def of_pairs(graph: SceneGraph, config: Any) -> Float[Array, "S"]:
    """Statistics of the distances between pairs of objects, the robot left out.

    Without `words`, two objects of one class share both words, and others share none.
    """
    nodes = graph.nodes
    words = jnp.stack([nodes.label, nodes.label], axis=-1)
    if config.words:
        words = jnp.array(config.words).reshape(-1, 2)[nodes.label]
    there = nodes.present & ~nodes.is_robot
    return pair_statistics(nodes.center / config.length_unit, words, there)[0].reshape(-1)
