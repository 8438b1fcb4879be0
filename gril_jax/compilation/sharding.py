"""One training program on many devices: split by seed first, then by a seed's environments.

    layout = mesh(jax.devices(), seeds=8, num_envs=4096)
    state = init(algorithm, layout, keys, hyper)                # each with a leading axis of seeds
    run, shapes = advance(algorithm, layout, state, hyper, params, updates=20, evaluation=(env,))
    part = begun(state, shapes)
    part, (scores, finite) = run(part, hyper, reward_params, first, last, count)

or, before there is a state, `lowered(algorithm, layout, keys, hyper, params, updates).compile()`.

The program is the one for a single device, and the compiler splits it along the axes laid out here,
so that results agree up to the order of float sums. The devices of several hosts are one mesh.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool

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
    shapes: training.Part  # of its first argument, with their shardings


class Lowered(NamedTuple):
    """A traced training program, still to be compiled."""

    init: Future[Any]  # being compiled already
    advance: Any
    shapes: training.Part

    def compile(self) -> Compiled:
        """Compiles it: most of the work, without Python's lock."""
        return Compiled(self.init.result(), compiled(self.advance), self.shapes)


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
    params = jax.tree.map(lambda x: _abstract(x, by_seed(layout)), reward_params)
    run, part = advance(algorithm, layout, shapes, hyper, params, updates, evaluation)
    number = jnp.int32(0)
    return Lowered(ready, run.lower(part, hyper, params, number, number, number), part)


def _abstract(x: Any, sharding: NamedSharding) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=sharding)


def advance(
    algorithm: training.Algorithm,
    layout: Mesh,
    state: Any,
    hyper: Any,
    reward_params: Any,
    updates: int,
    evaluation: tuple[Any, ...] = (),
) -> tuple[Callable[..., tuple[training.Part, tuple[Any, Any]]], training.Part]:
    """`training.moved` over seeds, compiled once, and the shapes of its first argument.

    It is (part, hyper, reward parameters, first, last, count) -> (part, (scores, finite)), the
    first three with a leading axis of seeds, and so what it returns. `finite`, (S,), is False for
    seeds whose policy is not. Metrics, scores and `finite` come back whole to every host. The part
    is donated. Of the arguments here, shapes and types will do.
    """

    def run(part, hyper, reward_params, first, last, count):
        def one(part, hyper, reward_params):
            part, scores = training.moved(
                algorithm, part, hyper, reward_params, evaluation=evaluation, first=first,
                last=last, count=count,
            )  # fmt: skip
            return part, (scores, _finite(algorithm.policy(part.state)))

        return jax.vmap(one)(part, hyper, reward_params)

    def fresh(state, hyper, reward_params):
        part = training.begin(algorithm, state, hyper, reward_params, updates=updates)
        if not evaluation:
            return part._replace(playing=())
        return part._replace(playing=training.fresh_evaluation(algorithm, evaluation, part.key))

    shapes = jax.eval_shape(jax.vmap(fresh), state, hyper, reward_params)
    by_both = NamedSharding(layout, PartitionSpec("seeds", "envs"))
    everywhere = NamedSharding(layout, PartitionSpec())
    placed = training.Part(
        shardings(layout, shapes.state),
        jax.tree.map(lambda _: everywhere, shapes.rows),
        by_seed(layout),
        jax.tree.map(lambda x: by_both if x.ndim > 1 else by_seed(layout), shapes.playing),
    )
    program = jax.jit(run, donate_argnums=0, out_shardings=(placed, everywhere))
    return program, jax.tree.map(_abstract, shapes, placed)


def _finite(tree: Any) -> Bool[Array, ""]:
    floats = [x for x in jax.tree.leaves(tree) if jnp.issubdtype(x.dtype, jnp.floating)]
    return jnp.stack([jnp.isfinite(x).all() for x in floats]).all()


def begun(state: Any, shapes: training.Part) -> training.Part:
    """The first chunk of a training that stands at `state`, whose other parts are still blank."""
    blank, kind = shapes._replace(state=()), jax.random.key_impl(state.key)

    def nothing(like: jax.ShapeDtypeStruct) -> Array:
        if not jnp.issubdtype(like.dtype, jax.dtypes.prng_key):
            return jnp.zeros(like.shape, like.dtype)
        data = jax.eval_shape(jax.random.key_data, like)
        return jax.random.wrap_key_data(jnp.zeros(data.shape, data.dtype), impl=kind)

    where = jax.tree.map(lambda x: x.sharding, blank)
    made = jax.jit(lambda: jax.tree.map(nothing, blank), out_shardings=where)()
    return made._replace(state=state)
