"""Trains encoders that compile to the same program: seeds of one configuration, or rows alike.

    programs = compiled_for(configs, learner, pool)
    learned = train(programs, configs, name="pretrain", run=run, ...)
    learned.rewards, learned.measures                        # with a leading axis S

Everything that differs between them has a leading axis S. A single encoder is trained without that
axis inside its program, so that it has the numbers of a program of its own.
"""

import functools
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from gril_jax.compilation import ahead, sharding
from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.pretraining.pretrain import Part
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs import loop
from gril_jax.runs.memory import Run
from gril_jax.runs.pace import Pace
from gril_jax.runs.progress import Progress
from gril_jax.workflows.build import learners, setup

from . import diverged

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

    updates: int  # of a chunk
    keys: Any
    data: Any  # of all seeds
    hyper: Any
    init: Future[Any]  # (keys, data) -> state, metrics before the first update
    step: Future[Any]  # ((state, metrics), (data, first, last), hyper) -> state, metrics
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

    def init(key: Any, data: Any) -> tuple[Any, Any]:
        return learner.init(key, data), learner.metrics

    def step(carry: Any, data: Any, hyper: Any) -> tuple[Any, Any]:
        (state, metrics), (data, first, last) = carry, data
        return learner.step(state, data, hyper, Part(metrics, first, last))

    def shapes() -> Any:
        made = jax.eval_shape(each(init), begin, data)
        placed = functools.partial(jax.ShapeDtypeStruct, sharding=by_seed)
        return jax.tree.map(lambda x: placed(x.shape, x.dtype), made)

    def ready(function: Callable, args: Callable[[], Any], brief: bool, **options: Any) -> Any:
        with ahead.tracing():
            lowered = jax.jit(each(function), out_shardings=by_seed, **options).lower(*args())
        return compiled(lowered, brief=brief)

    def trained() -> Any:
        return shapes()[0], data, hyper

    def training() -> Any:
        return shapes(), (data, jnp.int32(0), jnp.int32(0)), hyper

    few = boxes and config.pretrain.steps <= _FEW_UPDATES
    # In this order: the first ones take longest.
    stepping = pool.submit(ready, step, training, few, donate_argnums=0)
    starting = pool.submit(ready, init, lambda: (begin, data), boxes)
    measure = pool.submit(ready, learner.measure, trained, boxes)
    reward = pool.submit(ready, learner.reward, trained, boxes)
    updates = learner.static.updates
    return Programs(updates, begin, data, hyper, starting, stepping, reward, measure)


class Learned(NamedTuple):
    """S trained encoders, on the device but for `diverged`."""

    state: Any
    rewards: RewardParams
    measures: dict[str, Any]
    diverged: dict[int, str]  # a sentence for each place of a seed that did


def train(
    programs: Programs,
    configs: Sequence[RunConfig],
    *,
    name: str,
    run: Run,
    progress: Progress,
    echo: Echo,
    what: str,
    row: Callable[[Any], dict[str, Any]],
) -> Learned:
    """Runs all gradient steps as the phase `name`.

    Args:
      configs: those of the programs; steps and checkpoints are the same in all.
      what: what is learned, for the progress bar.
      row: from a chunk's metrics, (S, updates) each, to its line of metrics.jsonl.

    Raises:
      DivergedError: no encoder is left whose numbers are finite.
    """
    config, updates, pace = configs[0], programs.updates, Pace()
    data, hyper = programs.data, programs.hyper
    phase = progress.phase(what, total=config.pretrain.steps)  # first it compiles
    fresh, step = programs.init.result()(programs.keys, data), programs.step.result()

    def lost(bad: Any) -> dict[int, str]:
        found = diverged.faults(bad, fresh[1]._fields)
        return {place: diverged.of_reward(configs[place], one) for place, one in found.items()}

    def advance(held: Any, chunk: int, made: int) -> tuple[Any, int, Any]:
        (carry, bad), began = held, time.monotonic()
        last = made + pace.moves(updates - made)
        carry = step(carry, (data, jnp.int32(made), jnp.int32(last)), hyper)
        metrics = jax.device_get(carry[1])
        pace.took(last - made, time.monotonic() - began)
        new = {name: x[:, made:last] for name, x in metrics._asdict().items()}
        bad = diverged.noted(bad, new, metrics._fields, chunk * updates + made)
        diverged.require_some(lost(bad), len(configs))
        phase.update(chunk * updates + last, loss=float(metrics.loss[:, made:last].mean()))
        return (carry, bad), last, metrics if last == updates else None

    def line(chunk: int, seconds: float, metrics: Any) -> dict[str, Any]:
        return {"step": chunk * updates} | row(metrics)

    begun = loop.restore(run, name, (fresh, diverged.unknown(len(configs))), tell=echo)
    (state, _), bad = loop.run_chunks(
        advance, begun, run=run, name=name, chunks=config.pretrain.steps // updates, row=line,
        every_s=config.run.checkpoint_every, start=lambda chunk: chunk * (updates + 1),
    ).state  # fmt: skip
    rewards = programs.reward.result()(state, data, hyper)
    measures = programs.measure.result()(state, data, hyper)
    said = lost(bad)
    for place in np.flatnonzero(~diverged.are_finite((rewards, measures))):
        said.setdefault(int(place), diverged.of_reward(configs[place], None))
    diverged.require_some(said, len(configs))
    return Learned(state, rewards, measures, said)


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
