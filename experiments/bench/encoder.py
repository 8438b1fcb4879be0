"""Time and memory of the paper's encoder on a batch of small graphs: dense against jraph.

The forms differ in how messages find their way and give the same numbers: "dense" (one sender at a
time) and "square" (all at once) are ours, "vmapped" is jraph graph by graph, "block_diagonal" is
jraph on one big graph of all. All split the first layer and share the thin product. Forms take
turns, so that a change of load hits all alike. A case takes about a minute on 2 CPU cores, most
of it gradients of 8,192 graphs.
"""

import time
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax.encoders import message_passing
from gril_jax.encoders.encoder import EncoderConfig
from gril_jax.graphs.scene import edge_indices, scene_graph

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
    """One graph whose parts are the graphs of a batch."""
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
    programs, forms = {}, {}
    for name, form in _FORMS.items():
        forms[name] = {}
        for kind in ("forward", "gradient"):
            programs[name, kind], forms[name][kind] = _compiled(form, kind, params, graphs, config)
    latents = {name: programs[name, "forward"](params, graphs) for name in _FORMS}
    times = {key: [] for key in programs}
    for _ in range(repeats):
        for key, program in programs.items():
            start = time.perf_counter()
            jax.block_until_ready(program(params, graphs))
            times[key].append(time.perf_counter() - start)
    for (name, kind), spent in times.items():
        forms[name][kind]["ms"] = round(1e3 * float(np.median(spent)), 3)
    for name in _FORMS:
        for kind in ("forward", "gradient"):
            ratio = forms[name][kind]["ms"] / forms["dense"][kind]["ms"]
            forms[name][kind]["times_dense"] = round(ratio, 2)
    worst = max(float(jnp.abs(x - latents["dense"]).max()) for x in latents.values())
    return {
        "graphs": num_graphs,
        "nodes": num_nodes,
        "width": config.width,
        "rounds": config.rounds,
        "repeats": repeats,
        "difference": worst,
        "forms": forms,
    }


def _compiled(form, kind, params, graphs, config):
    def latents(params, graphs):
        return form(params, graphs, config)

    def loss(params, graphs):
        return jnp.sum(jnp.square(latents(params, graphs)))

    wanted = latents if kind == "forward" else jax.grad(loss)
    start = time.perf_counter()
    program = jax.jit(wanted).lower(params, graphs).compile()
    compile_s = time.perf_counter() - start
    jax.block_until_ready(program(params, graphs))
    memory = program.memory_analysis()
    temporary = None if memory is None else round(memory.temp_size_in_bytes / 2**20, 1)
    return program, {"compile_s": round(compile_s, 2), "temporary_mb": temporary}
