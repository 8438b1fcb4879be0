"""The rewards of a table's rows: encoders that compile to the same program train side by side."""

import functools
from collections.abc import Callable, Hashable, Iterable, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from gril_jax import reward
from gril_jax.compilation import ahead, sharding
from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.config.tables import REWARDS
from gril_jax.runs import loop
from gril_jax.runs.progress import Progress
from gril_jax.runs.run_dir import RunDir
from gril_jax.types import DemoBatch
from gril_jax.workflows.build import demonstrations, learners, setup

from .rows import Row


class TrainedReward(NamedTuple):
    """A learned reward, its tau and its demonstrations."""

    params: reward.RewardParams
    tau: float
    demos: DemoBatch
    num_classes: int


def learns(config: RunConfig) -> bool:
    """True if a reward is learned for the policy."""
    return REWARDS[config.run.reward].learns


def reward_key(config: RunConfig) -> Hashable:
    """The part of the configuration that a learned reward depends on."""
    parts = (config.demos, config.encoder, config.pool, config.loss, config.pretrain)
    return task_key(config), parts, config.run.seed


# What policies alone are given: neither demonstrations nor encoders depend on it.
_OF_POLICIES = {
    "reward", "observation", "variant", "varied_starts", "near_starts"
}  # fmt: skip


def task_key(config: RunConfig) -> Hashable:
    """The task that demonstrations and encoders depend on."""
    return tuple(value for name, value in vars(config.env).items() if name not in _OF_POLICIES)


def keys(seeds: Sequence[int], stream: int):
    """The keys that a separate run of each seed would use."""
    return jax.vmap(lambda s: jax.random.fold_in(jax.random.key(s), stream))(jnp.array(seeds))


def stack(trees: Sequence[Any]) -> Any:
    """Trees of one structure with a leading axis."""
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


class _Ready(NamedTuple):
    """Encoders that share one compiled program."""

    updates: int  # of a chunk
    arguments: tuple[Any, Any, Any]  # keys, data, hyper
    init: Any  # (keys, data) -> state
    step: Any  # (state, data, hyper) -> (state, metrics)
    finish: Any  # the same -> (reward parameters, tau)


class Wanted(NamedTuple):
    """Rewards that share one program, which is being compiled."""

    keys: list[Hashable]
    config: RunConfig  # of one of them
    demos: demonstrations.Demonstrations
    ready: Future[_Ready]


def get_ready(
    rows: Sequence[Row],
    gather: Callable[[RunConfig], demonstrations.Demonstrations],
    pool: Executor,
) -> list[Wanted]:
    """Starts to compile, in a pool, the training of every reward that a row needs."""
    needed = {reward_key(row.config): row.config for row in rows if learns(row.config)}
    groups: dict[Hashable, list[Hashable]] = {}
    for key, config in needed.items():
        static = learners.static_config(config, len(gather(config).demo_set.classes))
        same = (task_key(config), config.demos, static, config.pretrain.steps)
        groups.setdefault(same, []).append(key)
    found = []
    for members in groups.values():
        configs = [needed[key] for key in members]
        demos = gather(configs[0])
        found.append(Wanted(members, configs[0], demos, pool.submit(_compiled, configs, demos)))
    return found


def tasks(
    wanted: Sequence[Wanted],
    found: dict[Hashable, TrainedReward],
    run: RunDir,
    progress: Progress,
    echo: Callable[[str], None],
) -> list[ahead.Task]:
    """One task per program, which adds its rewards to the found ones."""

    def learn(name: str, one: Wanted) -> None:
        found.update(_learned(name, one, run, progress, echo))

    return [
        ahead.Task(_name(i), one.ready, frozenset(), functools.partial(learn, _name(i), one))
        for i, one in enumerate(wanted)
    ]


def needed(wanted: Sequence[Wanted], rows: Iterable[Row]) -> frozenset[str]:
    """Names of the tasks that learn these rows' rewards."""
    asked = {reward_key(row.config) for row in rows if learns(row.config)}
    return frozenset(_name(i) for i, one in enumerate(wanted) if not asked.isdisjoint(one.keys))


def _name(number: int) -> str:
    return f"reward-{number}"


def _learned(
    name: str, one: Wanted, run: RunDir, progress: Progress, echo: Callable[[str], None]
) -> dict[Hashable, TrainedReward]:
    """Trains the encoders of a program."""
    ready, chosen = one.ready.result(), one.config
    keys, data, hyper = ready.arguments
    steps, updates = chosen.pretrain.steps, ready.updates
    phase = progress.phase(f"learning {len(one.keys)} rewards", total=steps)

    def row(chunk, seconds, metrics):
        phase.update(chunk * updates, loss=float(metrics.loss.mean()))
        return {"step": chunk * updates, "loss": metrics.loss.mean(axis=-1)}

    begun = loop.restore(run, name, ready.init(keys, data), tell=echo)
    state = loop.run_chunks(
        lambda state: ready.step(state, data, hyper), begun, run=run, name=name,
        chunks=steps // updates, row=row,
        every_s=chosen.run.checkpoint_every,
    ).state  # fmt: skip
    params, tau = jax.device_get(ready.finish(state, data, hyper))
    train, num_classes = one.demos.batch("train"), len(one.demos.demo_set.classes)
    return {
        key: TrainedReward(
            jax.tree.map(lambda x, i=i: x[i], params), float(tau[i]), train, num_classes
        )
        for i, key in enumerate(one.keys)
    }


def _compiled(configs: Sequence[RunConfig], demos) -> _Ready:
    learner = learners.learner(configs[0], demos)
    # Several processes train the same encoders, each on devices of its own.
    devices = jax.local_devices()
    layout = sharding.mesh(devices, seeds=len(configs), num_envs=len(devices))
    hyper = stack([jax.tree.map(jnp.float32, setup.pretrain_hyper(one)) for one in configs])
    hyper = sharding.place(layout, hyper)
    begin = sharding.place(layout, keys([config.run.seed for config in configs], 0))
    data = jax.device_put(learner.data, NamedSharding(layout, PartitionSpec()))
    each = _one_by_one(layout) if configs[0].encoder.kind == "pixels" else _side_by_side

    def measured(state, data, hyper):
        params = learner.reward(state, data, hyper)
        return params, learner.measure(state, data, hyper)["tau"]

    by_seed = sharding.by_seed(layout)
    init = jax.jit(each(learner.init), out_shardings=by_seed)
    step = jax.jit(each(learner.step), out_shardings=by_seed, donate_argnums=0)
    with ahead.tracing():
        state = jax.tree.map(
            lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=by_seed),
            jax.eval_shape(init, begin, data),
        )
        lowered = (
            init.lower(begin, data),
            step.lower(state, data, hyper),
            jax.jit(each(measured)).lower(state, data, hyper),
        )
    programs = map(compiled, lowered)
    return _Ready(learner.static.updates, (begin, data, hyper), *programs)


def _side_by_side(one: Callable) -> Callable:
    """Maps a function (seed's argument, data, more arguments of the seed) over many seeds."""
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
