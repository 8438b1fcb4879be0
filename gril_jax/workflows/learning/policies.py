"""Trains policies that compile to the same program: seeds of one configuration, or rows alike.

    program = compiled_for(configs, algorithm, jax.devices(), tasks, plan)
    trained = train(program, params, plan, configs, name="ppo", run=run, ...)

Everything that differs between them has a leading axis S.
"""

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.sharding import Mesh

from gril_jax.compilation import ahead, sharding
from gril_jax.config import RunConfig
from gril_jax.envs import Env
from gril_jax.errors import ConfigError
from gril_jax.rl import training
from gril_jax.runs import loop
from gril_jax.runs.memory import Run
from gril_jax.workflows.build import policy_rewards, policy_setup, setup
from gril_jax.workflows.build.starts import evaluated_from

from . import diverged, stopping
from .calls import Calls, hold
from .encoders import Echo, keys, stack

POLICY_STREAM = 1  # of a run's random numbers


class Plan(NamedTuple):
    """The updates of a training, in chunks of one row of metrics, and when it evaluates."""

    updates: int  # the most, where evaluations end it
    per_chunk: int
    evaluations: int
    steps: int  # environment steps of an update, of one policy
    episodes: int = 0  # of an evaluation, of either kind of actions
    least: int | None = None  # updates after which a plateau ends it; None: evaluations never do

    @property
    def chunks(self) -> int:
        """Number of rows of metrics."""
        return -(-self.updates // self.per_chunk)

    def done(self, chunks: int) -> int:
        """Updates after so many chunks."""
        return min(chunks * self.per_chunk, self.updates)

    def start(self, chunk: int) -> int:
        """Moves before a chunk: each has one for its evaluation, too."""
        return self.done(chunk) + chunk

    def count(self, chunk: int) -> int:
        """Updates of a chunk, counted from 0."""
        return self.done(chunk + 1) - self.done(chunk)

    def examines(self, chunk: int) -> bool:
        """True if an evaluation is scheduled in a chunk, which then ends with it."""
        due = [self.done(n) * self.evaluations // self.updates for n in (chunk, chunk + 1)]
        return due[0] != due[1]

    def evaluated_at(self, number: int) -> int:
        """Environment steps before an evaluation, counted from 0."""
        chunks = itertools.islice(filter(self.examines, range(self.chunks)), number, None)
        return self.done(next(chunks) + 1) * self.steps


def plan_of(config: RunConfig, algorithm: training.Algorithm) -> Plan:
    """The plan of a configuration; a ConfigError if its policy would have no reward."""
    own, env = config.run.reward_form in ("environmental", "shaped"), algorithm.episodes.env
    if own and not getattr(env, "rewarded", True):
        raise ConfigError(
            f"the policy would learn from the task's own reward, but the states of "
            f"{config.env.shown_name} have no `reward`: give them one, or learn a reward from "
            "demonstrations"
        )
    if config.run.evaluations and algorithm.num_envs % 2:
        name = config.run.algorithm
        raise ConfigError(
            f"{name}.num_envs is {algorithm.num_envs}, but must be even: half of the environments "
            "play deterministic actions in evaluations, which --run.evaluations 0 leaves out"
        )
    steps = algorithm.num_envs * algorithm.unroll_length
    updates = -(-policy_setup.policy_config(config).num_timesteps // steps)
    run, most = config.run, config.run.max_steps
    fixed = Plan(updates, run.updates_per_chunk, run.evaluations, steps, algorithm.num_envs // 2)
    if most is None or not evaluates(config, algorithm):
        return fixed
    # Evaluations come as often as they would in a training of the fixed length.
    at_most = -(-most // steps)
    often = max(1, round(run.evaluations * at_most / updates))
    return fixed._replace(updates=at_most, evaluations=often, least=min(updates, at_most))


class Compiled(NamedTuple):
    """The compiled training of S policies, and its arguments."""

    algorithm: training.Algorithm
    layout: Mesh
    functions: sharding.Compiled
    keys: Any
    hyper: Any
    seconds: float  # that compiling took


def compiled_for(
    configs: Sequence[RunConfig],
    algorithm: training.Algorithm,
    devices: Sequence[Any],
    tasks: Sequence[Any],
    plan: Plan,
) -> Compiled:
    """Compiles the training of configurations that differ in traced numbers and seeds alone.

    Parts of the environments are evaluated in these tasks, with both kinds of actions."""
    started = time.monotonic()
    layout = sharding.mesh(devices, seeds=len(configs), num_envs=algorithm.num_envs)
    with ahead.tracing():
        hyper = stack([policy_setup.algorithm_hyper(config) for config in configs])
        hyper = sharding.place(layout, hyper)
        begin = keys([config.run.seed for config in configs], POLICY_STREAM)
        blank = [policy_rewards.blank(configs[0], algorithm.episodes.env)] * len(configs)
        params = jax.eval_shape(lambda: stack(blank))
        most = min(plan.per_chunk, plan.updates)
        found = sharding.lowered(algorithm, layout, begin, hyper, params, most, tuple(tasks))
    done = found.compile()
    return Compiled(algorithm, layout, done, begin, hyper, time.monotonic() - started)


class Learned(NamedTuple):
    """The results of a training of S policies."""

    policy: Any  # leaves (S, ...): the last ones, or the best where evaluations end the training
    state: Any  # the algorithm's, after the last update
    env_steps: int  # in all, of each seed
    kept: list[int]  # environment steps after which the policy of each seed was as it is
    stall_s: float  # that the longest copy of a checkpoint held the training up
    diverged: Mapping[int, str]  # a sentence for each place of a seed that did


def train(
    program: Compiled,
    params: Any,
    plan: Plan,
    configs: Sequence[RunConfig],
    *,
    name: str,
    run: Run,
    echo: Echo,
    row: Callable[[int, Any], dict[str, Any]],
    tick: Callable[[int], None],
    wrong: Mapping[int, str] | None = None,
) -> Learned:
    """Runs all updates as the phase `name`, or those until evaluations end it.

    Args:
      params: the policy rewards' parameters (S, ...).
      configs: those of the program: steps and checkpoints are the same in all.
      row: from the chunks done and a chunk's (metrics, scores), on the host, to its line of
        metrics.jsonl; scores mean something where `plan.examines`.
      tick: is told the environment steps of each policy so far.
      wrong: a sentence for each place of a seed that does not count, since its reward diverged.

    Raises:
      DivergedError: no seed is left whose numbers are finite.
    """
    seeds, policy_of = len(program.keys), program.algorithm.policy
    diverged.require_some(wrong or {}, seeds)
    params = sharding.place(program.layout, params)
    part = program.functions.init(program.keys, program.hyper)
    part = sharding.begun(part, program.functions.shapes)
    calls = Calls(program, params, plan, configs, part.playing, wrong or {})
    fresh: Any = hold(part, seeds)
    if plan.least is not None:
        sizes = {"evaluations": plan.evaluations, "seeds": seeds}
        fresh = stopping.begin(fresh, policy_of(part.state), **sizes)

    def advance(state: Any, chunk: int, made: int) -> tuple[Any, int, Any]:
        held, made, found = calls.make(state if plan.least is None else state.state, chunk, made)
        tick((plan.done(chunk) + made) * plan.steps)
        if plan.least is None:
            return held, made, found
        state = state._replace(state=held)
        if found is not None and plan.examines(chunk):
            success, value = (x[:, 0, 0] for x in (found[1].success, found[1].reward))
            state = stopping.noted(state, success, value, policy_of(held.part.state))
        return state, made, found

    def is_over(done: int, state: Any) -> bool:
        if plan.least is None or not plan.examines(done - 1):
            return False
        return stopping.is_over(state, early=plan.done(done) < plan.least)

    def line(done: int, seconds: float, found: Any) -> dict[str, Any]:
        steps = plan.done(done) * plan.steps
        return row(done, found) | {"env_steps": steps, "env_steps_per_s": steps * seeds / seconds}

    done = loop.run_chunks(
        advance, loop.restore(run, name, fresh, tell=echo), run=run, name=name, chunks=plan.chunks,
        row=line, every_s=configs[0].run.checkpoint_every, start=plan.start, is_over=is_over,
    )  # fmt: skip
    steps, watched = plan.done(done.chunks) * plan.steps, done.state
    held = watched if plan.least is None else watched.state
    state, rest = held.part.state, (done.stall_s, calls.diverged(held.bad))
    if plan.least is None:
        return Learned(policy_of(state), state, steps, [steps] * seeds, *rest)
    kept = [plan.evaluated_at(int(number)) for number in stopping.best_so_far(watched)]
    return Learned(watched.best, state, steps, kept, *rest)


def evaluates(config: RunConfig, algorithm: training.Algorithm) -> bool:
    """True if policies are evaluated in training, each kind of actions in half of the
    environments."""
    return bool(config.run.evaluations) and algorithm.num_envs % 2 == 0


def tasks_to_evaluate(config: RunConfig, algorithm: training.Algorithm) -> list[Env]:
    """The task whose starts evaluations during training begin from; empty if there are none."""
    if not evaluates(config, algorithm):
        return []
    return [setup.make_env(config.env, training=False, variant=evaluated_from(config.env).many)]


def metrics_of(plan: Plan, done: int, found: Any) -> dict[str, list[float]]:
    """A chunk's line of metrics: of each quantity one number a policy.

    `found` are (metrics, scores) with a leading axis of policies, and `done` the chunks so far.
    Where an evaluation was scheduled, its scores with deterministic and sampled actions are there,
    too.
    """
    metrics, scores = found
    each = [
        _means({name: x[i][: plan.count(done - 1)] for name, x in metrics.items()})
        for i in range(len(metrics["success"]))
    ]
    line = {name: [one[name] for one in each] for name in each[0]}
    if scores is None or not plan.examines(done - 1):
        return line
    line["eval/episodes"] = [plan.episodes] * len(each)
    for kind, values in scores._asdict().items():
        line[f"eval/{kind}"] = [float(x) for x in values[:, 0, 0]]
        line[f"eval/{kind}_sampled"] = [float(x) for x in values[:, 0, 1]]
    return line


_OF_STEPS = "reward", "alpha", "ratio_beyond", "deviation"  # and losses; all else is of episodes


def _means(metrics: dict[str, np.ndarray]) -> dict[str, float]:
    """Means over one chunk's updates; the task's own metrics weigh each by its episodes."""
    episodes = metrics["episodes"]
    row = {}
    for name, values in metrics.items():
        if name in ("episodes", "nonfinite"):
            row[name] = float(values.sum())
        elif name not in _OF_STEPS and not name.startswith("loss/"):
            row[name] = float((values * episodes).sum() / max(episodes.sum(), 1.0))
        else:
            row[name] = float(values.mean())
    return row
