"""Trains encoders that compile to the same program: seeds of one configuration, or rows alike.

    programs = compiled_for(configs, learner, pool)
    state = train(programs, configs[0].pretrain.steps, name="pretrain", run=run, ...)
    rewards = programs.reward.result()(state, programs.data, programs.hyper)

Everything that differs between them has a leading axis S. A single encoder is trained without that
axis inside its program, so that it has the numbers of a program of its own.
"""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from gril_jax.compilation import ahead, sharding
from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.runs import loop
from gril_jax.runs.memory import Run
from gril_jax.runs.progress import Progress
from gril_jax.workflows.build import learners, setup

# Up to so many updates the compiler's slow optimisations save no time on a GPU: after 4,300 with
# displaced copies, 7,800 without (H200, JAX 0.11).
_FEW_UPDATES = 5000

Echo = Callable[[str], None]


def keys(seeds: Sequence[int], stream: int) -> Any:
    """The keys (S,) of one stream of random numbers; each is that of a run of its seed alone."""
    return jax.vmap(lambda s: jax.random.fold_in(jax.random.key(s), stream))(jnp.array(seeds))


def stack(trees: Sequence[Any]) -> Any:
    """Trees of one structure with a leading axis."""
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


class Programs(NamedTuple):
    """The programs of S encoders' training, being compiled, and their arguments."""

    updates: int  # of a call of `step`
    keys: Any
    data: Any  # of all seeds
    hyper: Any
    init: Future[Any]  # (keys, data) -> state
    step: Future[Any]  # (state, data, hyper) -> state, metrics
    reward: Future[Any]  # (state, data, hyper) -> reward parameters
    measure: Future[Any]  # (state, data, hyper) -> name to a number (S,)


def compiled_for(
    configs: Sequence[RunConfig], learner: learners.Learner, pool: Executor
) -> Programs:
    """Starts to compile, in a pool, the training of configurations that differ in traced numbers
    and seeds alone."""
    config, count = configs[0], len(configs)
    # Several processes train the same encoders, each on devices of its own.
    devices = jax.local_devices()
    layout = sharding.mesh(devices, seeds=count, num_envs=len(devices))
    hyper = stack([jax.tree.map(jnp.float32, setup.pretrain_hyper(one)) for one in configs])
    hyper = sharding.place(layout, hyper)
    begin = sharding.place(layout, keys([one.run.seed for one in configs], 0))
    data = jax.device_put(learner.data, NamedSharding(layout, PartitionSpec()))
    boxes = config.encoder.kind != "pixels"  # brief convolutions have not been measured
    each = _of_seeds(count, layout, in_turn=not boxes)
    by_seed = sharding.by_seed(layout)

    def shapes() -> Any:
        made = jax.eval_shape(each(learner.init), begin, data)
        placed = functools.partial(jax.ShapeDtypeStruct, sharding=by_seed)
        return jax.tree.map(lambda x: placed(x.shape, x.dtype), made)

    def ready(function: Callable, args: Callable[[], Any], brief: bool, **options: Any) -> Any:
        with ahead.tracing():
            lowered = jax.jit(each(function), out_shardings=by_seed, **options).lower(*args())
        return compiled(lowered, brief=brief)

    def trained() -> Any:
        return shapes(), data, hyper

    few = boxes and config.pretrain.steps <= _FEW_UPDATES
    # In this order: the first ones take longest.
    step = pool.submit(ready, learner.step, trained, few, donate_argnums=0)
    init = pool.submit(ready, learner.init, lambda: (begin, data), boxes)
    measure = pool.submit(ready, learner.measure, trained, boxes)
    reward = pool.submit(ready, learner.reward, trained, boxes)
    return Programs(learner.static.updates, begin, data, hyper, init, step, reward, measure)


def train(
    programs: Programs,
    config: RunConfig,
    *,
    name: str,
    run: Run,
    progress: Progress,
    echo: Echo,
    what: str,
    row: Callable[[Any], dict[str, Any]],
) -> Any:
    """Runs all gradient steps as the phase `name`; returns the states (S, ...).

    Args:
      config: one of the configurations: steps and checkpoints are the same in all.
      what: what is learned, for the progress bar.
      row: from a chunk's metrics, (S, updates) each, to its line of metrics.jsonl.
    """
    steps, updates = config.pretrain.steps, programs.updates
    data, hyper = programs.data, programs.hyper
    fresh, step = programs.init.result()(programs.keys, data), programs.step.result()
    phase = progress.phase(what, total=steps)

    def line(chunk: int, seconds: float, metrics: Any) -> dict[str, Any]:
        phase.update(chunk * updates, loss=float(metrics.loss.mean()))
        return {"step": chunk * updates} | row(metrics)

    begun = loop.restore(run, name, fresh, tell=echo)
    return loop.run_chunks(
        lambda state: step(state, data, hyper), begun, run=run, name=name, chunks=steps // updates,
        row=line, every_s=config.run.checkpoint_every,
    ).state  # fmt: skip


def _of_seeds(count: int, layout: Mesh, *, in_turn: bool) -> Callable[[Callable], Callable]:
    """What maps a function (seed's argument, data, more arguments of the seed) over S seeds."""
    if count == 1:
        return _alone
    return _one_by_one(layout) if in_turn else _side_by_side


def _alone(one: Callable) -> Callable:
    """For a single seed: its axis is taken off and put back."""

    def run(*args: Any) -> Any:
        first, data, *more = args
        first, *more = jax.tree.map(lambda x: x[0], [first, *more])
        return jax.tree.map(lambda x: x[None], one(first, data, *more))

    return run


def _side_by_side(one: Callable) -> Callable:
    return lambda first, data, *more: jax.vmap(lambda x, *y: one(x, data, *y))(first, *more)


def _one_by_one(layout: Mesh) -> Callable[[Callable], Callable]:
    """Like `_side_by_side` for networks with convolutions; each device runs its seeds in turn.

    Side by side they would be grouped convolutions, slower, and hold all activations at once.
    """

    def each(one: Callable) -> Callable:
        def mine(first, data, *more):
            return jax.lax.map(lambda seed: one(seed[0], data, *seed[1:]), (first, *more))

        def spread(first, data, *more):
            seeds = PartitionSpec("seeds")
            specs = (seeds, PartitionSpec(), *[seeds] * len(more))
            run = jax.shard_map(mine, mesh=layout, in_specs=specs, out_specs=seeds, check_vma=False)
            return run(first, data, *more)

        return spread

    return each
