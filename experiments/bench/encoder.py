"""Time and memory of the paper's encoder on a batch of small graphs: dense against jraph.

The forms differ in how messages find their way and give the same numbers: "dense" (one sender at a
time) and "square" (all at once) are ours, "vmapped" is jraph graph by graph, "block_diagonal" is
jraph on one big graph of all. All split the first layer and share the thin product. Forms take
turns, so that a change of load hits all alike. A case takes about a minute on 2 CPU cores, most
of it gradients of 8,192 graphs.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.encoders import message_passing
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.graphs.scene import edge_indices, scene_graph

from .frame import compile_timed, median_ms, times_in_turn

__all__ = ["block_diagonal", "measure", "random_graphs"]


def random_graphs(num_graphs: int, num_nodes: int, num_classes: int, *, seed: int = 0):
    """A batch of scene graphs with a robot, some objects active."""
    rng = np.random.default_rng(seed)
    shape = (num_graphs, num_nodes)
    return jax.vmap(scene_graph)(
        jnp.asarray(rng.uniform(-1, 1, (*shape, 2)), jnp.float32),
        jnp.asarray(rng.uniform(0.1, 0.5, (*shape, 2)), jnp.float32),
        jnp.asarray(rng.integers(0, num_classes, shape), jnp.int32),
        jnp.broadcast_to(jnp.arange(num_nodes) == 0, shape),
        jnp.asarray(rng.random(shape) < 0.5),
    )


def block_diagonal(graphs):
    """One graph that holds the graphs of a batch side by side."""
    num_graphs, num_nodes = graphs.nodes.label.shape
    senders, receivers = edge_indices(num_nodes)
    first = num_nodes * jnp.arange(num_graphs)[:, None]
    return graphs._replace(
        nodes=jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), graphs.nodes),
        edges=graphs.edges.reshape(-1, graphs.edges.shape[-1]),
        senders=(first + senders).reshape(-1),
        receivers=(first + receivers).reshape(-1),
        n_node=graphs.n_node.reshape(-1),
        n_edge=graphs.n_edge.reshape(-1),
    )


def _by_graph(form, params, graphs, config):
    senders, receivers = edge_indices(graphs.nodes.label.shape[1])

    def one(graph):
        graph = graph._replace(senders=senders, receivers=receivers)  # constants, also under vmap
        nodes = message_passing.node_embeddings(params, graph, config, form=form)
        return message_passing.readout(params, nodes, graph, config)

    return jax.vmap(one)(graphs)


def _as_one(params, graphs, config):
    whole = block_diagonal(graphs)
    nodes = message_passing.node_embeddings(params, whole, config, form="jraph")
    nodes = nodes.reshape(*graphs.nodes.label.shape, -1)
    return jax.vmap(partial(message_passing.readout, config=config), (None, 0, 0))(
        params, nodes, graphs
    )


_FORMS = {
    "dense": partial(_by_graph, "dense"),
    "square": partial(_by_graph, "square"),
    "vmapped": partial(_by_graph, "jraph"),
    "block_diagonal": _as_one,
}


def measure(
    num_graphs: int = 8192,
    num_nodes: int = 7,
    *,
    repeats: int = 9,
    config: EncoderConfig | None = None,
) -> dict:
    """Median milliseconds, compile seconds and temporary megabytes of each form, and ratios.

    Returns:
      For JSON. `forward` makes the latents; `gradient` the derivative of their squared sum by the
      parameters. `difference` is the largest one between the forms' latents; `times_dense` says
      how many times as long as "dense" each form takes.
    """
    config = config or EncoderConfig(num_classes=7)
    params = message_passing.init(jax.random.key(0), config)
    graphs = random_graphs(num_graphs, num_nodes, config.num_classes)
    programs = {
        (name, kind): compile_timed(_wanted(form, kind, config), params, graphs, plain=True)
        for name, form in _FORMS.items()
        for kind in ("forward", "gradient")
    }
    calls = {key: partial(program, params, graphs) for key, (program, _) in programs.items()}
    ms = median_ms(times_in_turn(calls, repeats))
    forms: dict[str, dict] = {name: {} for name in _FORMS}
    for (name, kind), (program, compile_s) in programs.items():
        memory = program.memory_analysis()
        forms[name][kind] = {
            "compile_s": round(compile_s, 2),
            "temporary_mb": memory and round(memory.temp_size_in_bytes / 2**20, 1),
            "ms": ms[name, kind],
            "times_dense": round(ms[name, kind] / ms["dense", kind], 2),
        }
    latents = [calls[name, "forward"]() for name in _FORMS]
    sizes = {"graphs": num_graphs, "nodes": num_nodes, "width": config.width}
    worst = max(float(jnp.abs(x - latents[0]).max()) for x in latents)
    runs = {"rounds": config.rounds, "repeats": repeats, "difference": worst}
    return {**sizes, **runs, "forms": forms}


def _wanted(form, kind, config):
    def latents(params, graphs):
        return form(params, graphs, config)

    def loss(params, graphs):
        return jnp.sum(jnp.square(latents(params, graphs)))

    return latents if kind == "forward" else jax.grad(loss)
