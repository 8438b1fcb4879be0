"""Trains a policy from videos: demonstrations, reward, policy, evaluation, report.

gril quickstart                    one block, about 4 minutes on two CPU cores
gril train match_regions           five blocks, sized for a GPU: see README for both results
gril train --resume RUN            go on with a run that was cut off
gril train quickstart --hard-negatives RUN    learn from states that RUN's reward overestimates
"""

import itertools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from gril_jax import envs
from gril_jax.compilation import ahead, sharding
from gril_jax.config import RunConfig
from gril_jax.report import rates, run_report
from gril_jax.report.audit import asked
from gril_jax.report.headline import in_words
from gril_jax.rl import training
from gril_jax.runs import loop, reading
from gril_jax.runs.checkpoints import checkpoint, state_leaves
from gril_jax.workflows import audit, evaluate, pretrain
from gril_jax.workflows.build import (
    demonstrations,
    own_task,
    policy_rewards,
    policy_setup,
    setup,
    stages,
)
from gril_jax.workflows.build.given import given
from gril_jax.workflows.build.starts import evaluated_from

from .pretrain import Echo, OpenRun, opened


def main(
    config: RunConfig,
    *,
    resume: Path | None = None,
    hard_negatives: Sequence[Path] = (),
    echo: Echo = print,
) -> Path:
    """Runs it, or goes on with the run in the folder `resume`; see `opened`. Returns its folder."""
    env = setup.make_env(config.env, training=False)
    own_task.require_demonstrations(config, env)
    if config.run.audit:
        audit.require_possible(config, env)
    if resume is None:
        demonstrations.require_usable(config, env)
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    layout = sharding.mesh(jax.devices(), seeds=1, num_envs=algorithm.num_envs)
    with opened(config, "train", resume, hard_negatives, echo) as run, ahead.compiling() as pool:
        begun = lapped = time.monotonic()

        def lap(name: str) -> None:
            nonlocal lapped
            now = time.monotonic()
            run.dir.times.append(stage=name, seconds=now - lapped)
            lapped = now

        found = run.dir.finished_phase("policy")
        program = pool.submit(compiled_for, config, algorithm, layout) if found is None else None
        demos = demonstrations.gather_once(config, env, run.dir, run.progress)
        lap("demonstrations")
        results = pretrain.learn(run, demos)
        reward_params = _policy_reward(run, env, demos)
        lap("reward")
        if program is not None:
            params = sharding.place(layout, _one(reward_params))
            found = _learn_policy(run, algorithm, program.result(), params)
        policy = policy_setup.restore_policy(run.path, config, algorithm)
        lap("policy")
        played = run.dir.finished_phase("evaluation")
        if played is None:
            played = evaluate.play(config, env, policy, reward_params, run.path, run.progress)
            run.dir.finish_phase("evaluation", played, [run.path / name for name in _PLAYED])
        lap("evaluation")
        results = results | found | played | _audited(run) | {"given": str(given(config))}
        lap("audit")
        run.dir.finish(results)
        writing = run.progress.phase("writing the report", total=1, unit="pages", compiles=False)
        page = run_report.write_report(run.path)
        writing.update(1)
    speed = reading.read_metrics(run.path, clocks=True)[-1].get("env_steps_per_s") or 0.0
    for line in (*rates.sentences(results), asked.sentence(results)):
        echo(line)
    echo(f"given: {results['given']}")
    echo(
        f"tau {results['tau']:.3f}, {speed:,.0f} env steps/s, "
        f"{in_words(time.monotonic() - begun)} in all\nreport: {page}"
    )
    return run.path


def _policy_reward(run: OpenRun, env: envs.Env, demos: demonstrations.Demonstrations) -> Any:
    """The policy reward's parameters, saved once beside the learned reward."""
    if run.dir.finished_phase("policy_reward") is None:
        learned = policy_setup.learned_reward(run.path, run.config, env)
        num_classes = len(env.classes)
        params = policy_rewards.parameters(run.config, learned, demos.batch("train"), num_classes)
        steps = run.config.pretrain.steps
        saved = checkpoint.save_part(run.path, "policy_reward", steps, params)
        run.dir.finish_phase("policy_reward", {}, [saved])
        if said := stages.note(run.config, params):
            run.echo(said)
    return policy_setup.policy_reward(run.path, run.config, env)


def _audited(run: OpenRun) -> dict[str, Any]:
    """The audit of the learned reward, once in a run, where the configuration asks for one."""
    ascents = run.config.run.audit
    if not ascents:
        return {}
    found = run.dir.finished_phase("audit")
    if found is None:
        phase = run.progress.phase("auditing the reward", total=ascents, unit="ascents")
        # It repeats to the byte, so what a process that was cut off left of it is written over.
        results = audit.main(run.path, ascents=ascents, seed=run.config.run.seed, echo=_silent)
        found = {"audit": asked.kept(results)}
        run.dir.finish_phase("audit", found)
        phase.update(ascents)
    return found


def _silent(line: str) -> None:
    """Says nothing: what an audit prints, the run says at its end."""


_PLAYED = ("rollout.mp4", "rollouts.npz")  # what `evaluate.play` writes


class _Program(NamedTuple):
    """Chunks of compiled updates for one seed on all devices."""

    compiled: sharding.Compiled
    keys: Any  # with a leading axis of one seed, as all that it takes
    hyper: Any
    seconds: float  # that compiling took


def compiled_for(config: RunConfig, algorithm: training.Algorithm, layout: Any) -> _Program:
    """The program of a policy's training, with what it begins from."""
    started = time.monotonic()
    keys = jax.random.fold_in(jax.random.key(config.run.seed), 1)[None]
    hyper = sharding.place(layout, _one(policy_setup.algorithm_hyper(config)))
    params = _one(policy_rewards.blank(config, algorithm.episodes.env))
    # Half of the environments play deterministic actions in evaluations.
    examines = config.run.evaluations > 0 and algorithm.num_envs % 2 == 0
    many = evaluated_from(config.env).many
    tasks = (setup.make_env(config.env, training=False, variant=many),) if examines else ()
    most = config.run.updates_per_chunk
    found = sharding.lowered(algorithm, layout, keys, hyper, params, most, tasks).compile()
    return _Program(found, keys, hyper, time.monotonic() - started)


def _one(tree: Any) -> Any:
    return jax.tree.map(lambda x: x[None], tree)


def _learn_policy(
    run: OpenRun, algorithm: training.Algorithm, program: _Program, params: Any
) -> dict[str, Any]:
    """Runs all updates, chunk by chunk; saves the policy and returns the results."""
    config, (compiled, keys, hyper, compile_s) = run.config, program
    name, per_chunk = config.run.algorithm, config.run.updates_per_chunk
    per_update = algorithm.num_envs * algorithm.unroll_length
    updates = -(-policy_setup.policy_config(config).num_timesteps // per_update)
    phase = run.progress.phase("learning the policy", total=updates * per_update, unit="env steps")
    begun = loop.restore(run.dir, name, compiled.init(keys, hyper), tell=run.echo)
    phase.update(min(begun.chunks * per_chunk, updates) * per_update)
    chunks = itertools.count(begun.chunks)

    def plan(chunk: int) -> tuple[Int[Array, ""], Bool[Array, ""]]:
        """The updates of a chunk, counted from 0, and whether it evaluates."""
        before, after = (min((chunk + end) * per_chunk, updates) for end in (0, 1))
        share = [done * config.run.evaluations // updates for done in (before, after)]
        return jnp.int32(after - before), jnp.asarray(share[0] != share[1])

    def advance(state):
        return compiled.advance(state, hyper, params, *plan(next(chunks)))

    def row(chunk, seconds, found):
        metrics, scores = jax.tree.map(lambda x: x[0], found)
        count, examined = plan(chunk - 1)
        means = _means({name: values[: int(count)] for name, values in metrics.items()})
        steps = min(chunk * per_chunk, updates) * per_update
        phase.update(steps, **{"success in training": means["success"]}, reward=means["reward"])
        scored: dict[str, float] = {}
        if scores is not None and bool(examined):  # with deterministic actions, and with sampled
            scored["eval/episodes"] = (
                algorithm.num_envs // 2
            )  # of either kind, as many starts drawn
            for kind, values in scores._asdict().items():
                scored[f"eval/{kind}"], scored[f"eval/{kind}_sampled"] = map(float, values[0])
        return {**means, **scored, "env_steps": steps, "env_steps_per_s": steps / seconds}

    trained = loop.run_chunks(
        advance, begun, run=run.dir, name=name, chunks=-(-updates // per_chunk), row=row,
        every_s=config.run.checkpoint_every,
    )  # fmt: skip
    state = jax.tree.map(lambda x: x[0], trained.state)
    results = {
        "env_steps": updates * per_update,
        "state_sha256": state_leaves.digest(state),
    }
    saved = checkpoint.save_part(run.path, "policy", results["env_steps"], algorithm.policy(state))
    run.dir.times.append(phase=name, compile_s=compile_s, checkpoint_stall_s=trained.stall_s)
    run.dir.finish_phase("policy", results, [saved])
    return results


def _means(metrics: dict[str, np.ndarray]) -> dict[str, float]:
    """Means over one chunk's updates; success and score weigh each update by its episodes."""
    episodes = metrics["episodes"]
    row = {}
    for name, values in metrics.items():
        if name in ("episodes", "nonfinite"):
            row[name] = float(values.sum())
        elif name in ("success", "score"):
            row[name] = float((values * episodes).sum() / max(episodes.sum(), 1.0))
        else:
            row[name] = float(values.mean())
    return row
