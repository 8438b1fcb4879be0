"""The two halves of a sweep: many encoders in one program, then many policies in one.

A row is one configuration with one seed. Rows that compile to the same program are trained side by
side by `jax.vmap`; what differs between them are arrays.
"""

import itertools
import shutil
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from gril_jax import checkpoint, device_memory, hosts, reward, training_loop
from gril_jax.config import RunConfig
from gril_jax.errors import ConfigError
from gril_jax.progress import Progress
from gril_jax.rl import memory, sharding, training
from gril_jax.run_dir import RunDir
from gril_jax.types import DemoBatch

from . import demonstrations, learners, policy_rewards, policy_setup, setup

__all__ = [
    "LearnedReward",
    "Program",
    "Row",
    "learn_policies",
    "learn_rewards",
    "programs",
    "reward_key",
]


class Row(NamedTuple):
    """One policy to train."""

    cell: int
    seed: int
    config: RunConfig


class LearnedReward(NamedTuple):
    """A reward with what it was learned from."""

    params: reward.RewardParams
    tau: float
    demos: DemoBatch
    num_classes: int


class Program(NamedTuple):
    """Rows that are trained together."""

    name: str
    rows: list[Row]
    algorithm: training.Algorithm
    tasks: Mapping[str, Any]  # to evaluate in, by where they start; the first is the main one
    updates: int


def reward_key(config: RunConfig) -> Hashable:
    """What a learned reward depends on."""
    parts = (config.env, config.demos, config.encoder, config.pool, config.loss, config.pretrain)
    return parts, config.run.seed


def learn_rewards(
    rows: Sequence[Row],
    gather: Callable[[RunConfig], demonstrations.Demonstrations],
    run: RunDir,
    progress: Progress,
    echo: Callable[[str], None],
) -> dict[Hashable, LearnedReward]:
    """The reward of every row that needs one, each trained once, with its tau."""
    needed = {
        reward_key(row.config): row.config
        for row in rows
        if row.config.run.reward != "environmental"
    }
    groups: dict[Hashable, list[Hashable]] = {}
    for key, config in needed.items():
        demos = gather(config)
        static = learners.static_config(config, len(demos.demo_set.classes))
        same = (config.env, config.demos, static, config.pretrain.steps)
        groups.setdefault(same, []).append(key)
    found: dict[Hashable, LearnedReward] = {}
    for number, keys in enumerate(groups.values()):
        configs = [needed[key] for key in keys]
        demos = gather(configs[0])
        num_classes = len(demos.demo_set.classes)
        name = f"reward-{number}"
        params, tau = _encoders(name, configs, demos, run, progress, echo)
        for i, key in enumerate(keys):
            one = jax.tree.map(lambda x, i=i: x[i], params)
            found[key] = LearnedReward(one, float(tau[i]), demos.batch("train"), num_classes)
    return found


def _encoders(name, configs, demos, run: RunDir, progress: Progress, echo):
    """Stacked reward parameters and taus of configurations that share one program."""
    learner = learners.learner(configs[0], demos)
    # Several processes train the same encoders, each on devices of its own.
    devices = jax.local_devices()
    layout = sharding.mesh(devices, seeds=len(configs), num_envs=len(devices))
    hyper = _stack([_arrays(setup.pretrain_hyper(config)) for config in configs])
    hyper = sharding.place(layout, hyper)
    keys = sharding.place(layout, _keys([config.run.seed for config in configs], 0))
    data = jax.device_put(learner.data, NamedSharding(layout, PartitionSpec()))
    each = _one_by_one(layout) if configs[0].encoder.kind == "pixels" else _side_by_side
    compiled = partial(jax.jit, out_shardings=sharding.by_seed(layout))
    fresh = compiled(each(learner.init))(keys, data)
    step = compiled(each(learner.step), donate_argnums=0)
    steps, updates = configs[0].pretrain.steps, learner.static.updates
    phase = progress.phase(f"learning {len(configs)} rewards", total=steps)

    def row(chunk, seconds, metrics):
        phase.update(chunk * updates, loss=float(metrics.loss.mean()))
        return {"step": chunk * updates, "loss": metrics.loss.mean(axis=-1)}

    state = training_loop.run_chunks(
        lambda state: step(state, data, hyper),
        training_loop.restore(run, name, fresh, tell=echo),
        run=run,
        name=name,
        chunks=steps // updates,
        row=row,
        every_s=configs[0].run.checkpoint_every,
        keep=configs[0].run.keep_checkpoints,
    ).state

    def finish(state, data, hyper):
        params = learner.reward(state, data, hyper)
        return params, learner.measure(state, data, hyper)["tau"]

    return jax.device_get(jax.jit(each(finish))(state, data, hyper))


def _side_by_side(one: Callable) -> Callable:
    """A function of a seed's argument, of the data, and of more of the seed's, for many seeds."""
    return lambda first, data, *more: jax.vmap(lambda x, *y: one(x, data, *y))(first, *more)


def _one_by_one(layout: Mesh) -> Callable[[Callable], Callable]:
    """The same for networks with convolutions, each device with its seeds one after the other.

    Side by side they would be grouped convolutions, which are slower than those of one network, and
    would hold the activations of all seeds at once.
    """

    def each(one: Callable) -> Callable:
        def mine(first, data, *more):
            return jax.lax.map(lambda seed: one(seed[0], data, *seed[1:]), (first, *more))

        def spread(first, data, *more):
            seeds, all_of_it = PartitionSpec("seeds"), PartitionSpec()
            specs = (seeds, all_of_it, *[seeds] * len(more))
            return jax.shard_map(
                mine, mesh=layout, in_specs=specs, out_specs=seeds, check_vma=False
            )(first, data, *more)

        return spread

    return each


def programs(
    rows: Sequence[Row], num_classes: int, devices: Sequence[Any], *, starts: Sequence[str] = ()
) -> list[Program]:
    """The rows by what they compile, in parts that fit into the devices' memory.

    Args:
      rows: the policies.
      num_classes: of the task's objects.
      devices: to train on.
      starts: variants of the task to evaluate in; its own alone where there is none.

    Raises:
      ConfigError: one seed does not fit, the devices cannot share a part evenly, or the
        environments cannot be shared out between the evaluations.
    """
    groups: dict[Hashable, list[Row]] = {}
    made: dict[Hashable, training.Algorithm] = {}
    for row in rows:
        chosen = policy_setup.policy_config(row.config)
        algorithm = policy_setup.make_algorithm(
            row.config, setup.make_env(row.config.env, training=True)
        )
        encoder = setup.encoder_config(row.config, num_classes)
        kind = (row.config.run.reward, row.config.run.evaluations, chosen.num_timesteps)
        key = (row.config.env, algorithm.static, encoder, kind)
        if not _examinations(len(starts) or 1, algorithm.num_envs):
            raise ConfigError(
                f"{row.config.run.algorithm}.num_envs is {algorithm.num_envs}, but must be "
                + (f"a multiple of {2 * len(starts)}" if len(starts) > 1 else "even")
                + ": in the evaluations of a sweep half of the environments play mean actions"
            )
        made.setdefault(key, algorithm)
        groups.setdefault(key, []).append(row)
    found: list[Program] = []
    for key, members in groups.items():
        algorithm, config = made[key], members[0].config
        params = policy_rewards.blank(config, algorithm.episodes.env)
        needed = memory.predict_bytes(algorithm, policy_setup.algorithm_hyper(config), params)
        each = memory.split(len(members), needed, _available_bytes(), len(devices))
        per_update = algorithm.num_envs * algorithm.unroll_length
        updates = -(-policy_setup.policy_config(config).num_timesteps // per_update)
        tasks = {
            variant: setup.make_env(config.env, training=False, variant=variant)
            for variant in starts or (config.env.variant,)
        }
        for start in range(0, len(members), each):
            part = members[start : start + each]
            sharding.mesh(devices, seeds=len(part), num_envs=algorithm.num_envs)
            found.append(Program(f"policy-{len(found)}", part, algorithm, tasks, updates))
    return found


def _examinations(starts: int, num_envs: int) -> int:
    """In how many parts the environments are examined, at least one for each kind of start.

    Each part is halved, for mean actions and samples; 0 if no number below twice the starts fits.
    """
    fitting = (n for n in range(starts, 2 * starts) if num_envs % (2 * n) == 0)
    return next(fitting, 0)


def _available_bytes() -> int | None:
    """Memory of the device that has least, in whichever process."""
    found = [device_memory.available_bytes(device) for device in jax.local_devices()]
    known = [x >> 20 for x in found if x is not None]  # MiB, so that they are small numbers
    if len(known) < len(found):
        return None
    (least,) = hosts.largest([-min(known)])
    return -least << 20


def learn_policies(
    program: Program,
    rewards: dict[Hashable, LearnedReward],
    run: RunDir,
    progress: Progress,
    echo: Callable[[str], None],
    devices: Sequence[Any],
) -> dict[str, Any]:
    """Train a program's policies; their scores while they learn are rows of metrics.jsonl.

    In these `success` is with mean actions in the first of the tasks, `success_sampled` with
    samples, and `success_layout` and `success_layout_sampled` are the same in the task "layout".
    """
    rows, algorithm = program.rows, program.algorithm
    configs = [row.config for row in rows]
    layout = sharding.mesh(devices, seeds=len(rows), num_envs=algorithm.num_envs)
    hyper = _stack([policy_setup.algorithm_hyper(config) for config in configs])
    # Each process has learned rewards; rounding may have driven them apart.
    params = hosts.same_everywhere(_stack([_policy_reward(config, rewards) for config in configs]))
    hyper, params = sharding.place(layout, hyper), sharding.place(layout, params)
    keys = _keys([config.run.seed for config in configs], 1)
    fresh = sharding.init(algorithm, layout, keys, hyper)
    begun = training_loop.restore(run, program.name, fresh, tell=echo)
    # A chunk is an evaluation with the updates before it, of which there are about as many in each.
    chunks = max(1, min(configs[0].run.evaluations, program.updates))
    done_by = [program.updates * k // chunks for k in range(chunks + 1)]
    most = -(-program.updates // chunks)
    parts = _examinations(len(program.tasks), algorithm.num_envs)
    where = [*program.tasks, *[[*program.tasks][-1]] * (parts - len(program.tasks))]
    tasks = tuple(program.tasks[name] for name in where)
    advance = sharding.advance(algorithm, layout, fresh, most, tasks)
    per_update = algorithm.num_envs * algorithm.unroll_length
    phase = progress.phase(
        f"learning {len(rows)} policies",
        total=program.updates * per_update * len(rows),
        unit="env steps",
    )

    def row(chunk, seconds, metrics):
        _, scores = metrics
        steps = done_by[chunk] * per_update
        phase.update(steps * len(rows), success=float(scores.success[..., 1].mean()))
        found = {"env_steps": steps, "env_steps_per_s": steps * len(rows) / seconds}
        return found | _by_start(where, scores)

    numbers = itertools.count(begun.chunks)

    def step(state):
        number = next(numbers)
        count = jnp.int32(done_by[number + 1] - done_by[number])
        return advance(state, hyper, params, count, jnp.asarray(True))

    done = training_loop.run_chunks(
        step,
        begun,
        run=run,
        name=program.name,
        chunks=chunks,
        row=row,
        every_s=configs[0].run.checkpoint_every,
        keep=configs[0].run.keep_checkpoints,
    )
    folder = run.path / "policies" / program.name
    shutil.rmtree(folder, ignore_errors=True)  # of a process that was cut off here
    checkpoint.save(
        folder, program.updates * per_update, hosts.gathered(algorithm.policy(done.state))
    )
    return {
        "rows": [(row.cell, row.seed) for row in rows],
        "taus": [_tau(config, rewards) for config in configs],
        "seconds": done.seconds,
    }


def _by_start(where: Sequence[str], scores: training.Scores) -> dict[str, Any]:
    """The scores of each policy by their names in metrics.jsonl, from (policies, parts, 2)."""
    found = {}
    for start in dict.fromkeys(where):
        parts = [i for i, name in enumerate(where) if name == start]
        suffix = "" if start == where[0] else f"_{start}"
        for name, values in scores._asdict().items():
            mean, sampled = values[:, parts].mean(axis=1).T
            found[f"{name}{suffix}"], found[f"{name}{suffix}_sampled"] = mean, sampled
    return found


def _policy_reward(config: RunConfig, rewards: dict[Hashable, LearnedReward]) -> Any:
    if config.run.reward == "environmental":
        return ()
    found = rewards[reward_key(config)]
    return policy_rewards.parameters(config, found.params, found.demos, found.num_classes)


def _tau(config: RunConfig, rewards: dict[Hashable, LearnedReward]) -> float | None:
    return None if config.run.reward == "environmental" else rewards[reward_key(config)].tau


def _keys(seeds: Sequence[int], stream: int):
    """The keys that a run of each seed by itself uses."""
    return jax.vmap(lambda s: jax.random.fold_in(jax.random.key(s), stream))(jnp.array(seeds))


def _stack(trees: Sequence[Any]) -> Any:
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


def _arrays(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), tree)
