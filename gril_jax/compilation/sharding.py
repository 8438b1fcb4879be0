"""One training program on many devices: split by seed first, then by a seed's environments.

    layout = mesh(jax.devices(), seeds=8, num_envs=4096)
    state = init(algorithm, layout, keys, hyper)                # each with a leading axis of seeds
    run = advance(algorithm, layout, state, updates=20, evaluation=(env,))
    state, (metrics, scores) = run(state, hyper, reward_params, count, examine)

or, before there is a state, `lowered(algorithm, layout, keys, hyper, params, updates).compile()`.

The program is the one for a single device, and the compiler splits it along the axes laid out here,
so that results agree up to the order of float sums. The devices of several hosts are one mesh.
"""

import functools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from gril_jax.errors import ConfigError
from gril_jax.rl import training

from .compiler import compiled


def mesh(devices: Sequence[Any], *, seeds: int, num_envs: int) -> Mesh:
    """Devices as a grid of axes "seeds" and "envs", with as many as possible on "seeds"; a
    ConfigError if they cannot be shared out evenly."""
    count = len(devices)
    across = math.gcd(count, seeds)
    if num_envs % (count // across):
        raise ConfigError(
            f"{count} devices cannot share {seeds} seeds of {num_envs} environments evenly: the "
            f"seeds must be a multiple of {count}, or num_envs of {count // across}"
        )
    shape, auto = (across, count // across), (AxisType.Auto,) * 2
    return jax.make_mesh(shape, ("seeds", "envs"), axis_types=auto, devices=devices)


def by_seed(layout: Mesh) -> NamedSharding:
    """The sharding of arrays with a leading axis of seeds."""
    return NamedSharding(layout, PartitionSpec("seeds"))


def shardings(layout: Mesh, state: Any) -> Any:
    """The sharding of each leaf of a training state with a leading axis of seeds.

    Leaves of `state.envs` have the environments as their second axis; all others are the same for
    all devices that share a seed.
    """
    by_both = NamedSharding(layout, PartitionSpec("seeds", "envs"))
    placed = jax.tree.map(lambda _: by_seed(layout), state)
    running = jax.tree.map(lambda x: by_both if x.ndim > 1 else by_seed(layout), state.envs)
    return placed._replace(envs=running)


def place(layout: Mesh, tree: Any) -> Any:
    """Puts a tree with a leading axis of seeds, such as hyper-parameters, on its seeds' devices."""
    return jax.device_put(tree, by_seed(layout))


def init(algorithm: training.Algorithm, layout: Mesh, keys: Any, hyper: Any) -> Any:
    """A fresh training state for each key, made on its devices."""
    return _maker(algorithm, layout, keys, hyper)[0](keys, hyper)


def _maker(algorithm: training.Algorithm, layout: Mesh, keys: Any, hyper: Any) -> tuple:
    """The program of `init`, jitted: (keys, hyper) -> state; and the shapes of its state."""
    make = jax.vmap(algorithm.init)
    shapes = jax.eval_shape(make, keys, hyper)
    return jax.jit(make, out_shardings=shardings(layout, shapes)), shapes


class Compiled(NamedTuple):
    """A compiled training program."""

    init: Any  # (keys, hyper) -> state
    advance: Any  # of `advance`


class Lowered(NamedTuple):
    """A traced training program, still to be compiled."""

    init: Future[Any]  # being compiled already
    advance: Any

    def compile(self) -> Compiled:
        """Compiles it: most of the work, without Python's lock."""
        return Compiled(self.init.result(), compiled(self.advance))


def lowered(
    algorithm: training.Algorithm,
    layout: Mesh,
    keys: Any,
    hyper: Any,
    reward_params: Any,
    updates: int,
    evaluation: tuple[Any, ...] = (),
) -> Lowered:
    """Traces `init` and `advance` ahead of time, without computing anything.

    The small one is compiled in a thread while the large one is traced. Keys and hyper-parameters
    are placed; of the reward's parameters, shapes and types will do.
    """
    make, shapes = _maker(algorithm, layout, keys, hyper)
    thread = ThreadPoolExecutor(1, "compile init")
    ready = thread.submit(compiled, make.lower(keys, hyper))
    thread.shutdown(wait=False)
    state = jax.tree.map(_abstract, shapes, shardings(layout, shapes))
    params = jax.tree.map(lambda x: _abstract(x, by_seed(layout)), reward_params)
    run = advance(algorithm, layout, shapes, updates, evaluation)
    count, examine = jnp.int32(0), jnp.asarray(True)
    return Lowered(ready, run.lower(state, hyper, params, count, examine))


def _abstract(x: Any, sharding: NamedSharding) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=sharding)


def advance(
    algorithm: training.Algorithm,
    layout: Mesh,
    state: Any,
    updates: int,
    evaluation: tuple[Any, ...] = (),
) -> Callable[[Any, Any, Any, Any, Any], tuple[Any, tuple[Any, Any]]]:
    """`training.chunk` over seeds, compiled once: (state, hyper, reward parameters, count, examine)
    -> (state, (metrics, scores)), the first three with a leading axis of seeds, and so what it
    returns. Metrics and scores come back whole to every host. The state is donated.
    """

    def chunk(state, hyper, reward_params, count, examine):
        how = {"updates": updates, "evaluation": evaluation, "count": count, "examine": examine}
        one = functools.partial(training.chunk, algorithm, **how)
        state, metrics, scores = jax.vmap(one)(state, hyper, reward_params)
        return state, (metrics, scores)

    everywhere = NamedSharding(layout, PartitionSpec())
    placed = shardings(layout, state)
    return jax.jit(chunk, donate_argnums=0, out_shardings=(placed, everywhere))
