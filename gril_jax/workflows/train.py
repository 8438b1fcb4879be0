"""Trains a policy from videos: demonstrations, reward, policy, evaluation, report.

gril quickstart                    one block, about 4 minutes on two CPU cores
gril train match_regions           five blocks, sized for a GPU: see README for both results
gril train --resume RUN            go on with a run that was cut off
gril train quickstart --hard-negatives RUN    learn from states that RUN's reward overestimates
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from gril_jax import envs
from gril_jax.compilation import ahead, sharding
from gril_jax.config import RunConfig
from gril_jax.report import rates, run_report
from gril_jax.report.audit import asked
from gril_jax.report.headline import in_words
from gril_jax.rl import training
from gril_jax.runs.checkpoints import state_leaves
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
from gril_jax.workflows.learning import policies

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
    sharding.mesh(jax.devices(), seeds=1, num_envs=algorithm.num_envs)  # or it cannot be shared out
    with opened(config, "train", resume, hard_negatives, echo) as run, ahead.compiling() as pool:
        begun = lapped = time.monotonic()

        def lap(name: str) -> None:
            nonlocal lapped
            now = time.monotonic()
            run.dir.note_time(stage=name, seconds=now - lapped)
            lapped = now

        found = run.dir.finished_phase("policy")
        program = pool.submit(compiled_for, config, algorithm) if found is None else None
        demos = demonstrations.gather_once(config, env, run.dir, run.progress)
        lap("demonstrations")
        results = pretrain.learn(run, demos)
        reward_params = _policy_reward(run, env, demos)
        lap("reward")
        if program is not None:
            params = jax.tree.map(lambda x: x[None], reward_params)
            found = _learn_policy(run, program.result(), params)
        blank = policy_setup.fresh_policy(config, algorithm, jax.random.key(0))
        policy = run.dir.load_part("policy", blank)
        lap("policy")
        played = run.dir.finished_phase("evaluation")
        if played is None:
            played = evaluate.play(config, env, policy, reward_params, run.path, run.progress)
            run.dir.finish_phase("evaluation", played, [run.path / name for name in _PLAYED])
        lap("evaluation")
        results = results | found | played | _audited(run) | {"given": str(given(config))}
        lap("audit")
        run.dir.finish(results)
        speed = run.dir.metrics()[-1].get("env_steps_per_s") or 0.0
        writing = run.progress.phase("writing the report", total=1, unit="pages", compiles=False)
        page = run_report.write_report(run.path)
        writing.update(1)
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
        num_classes = len(env.classes)
        learned = run.dir.load_part("reward", setup.blank_reward(run.config, num_classes))
        params = policy_rewards.parameters(run.config, learned, demos.batch("train"), num_classes)
        steps = run.config.pretrain.steps
        saved = run.dir.save_part("policy_reward", steps, params)
        run.dir.finish_phase("policy_reward", {}, saved)
        if said := stages.note(run.config, params):
            run.echo(said)
    return run.dir.load_part("policy_reward", policy_rewards.blank(run.config, env))


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


def compiled_for(config: RunConfig, algorithm: training.Algorithm) -> policies.Compiled:
    """The program of a policy's training; half of its environments play deterministic actions in
    evaluations."""
    examines = config.run.evaluations > 0 and algorithm.num_envs % 2 == 0
    many = evaluated_from(config.env).many
    tasks = [setup.make_env(config.env, training=False, variant=many)] if examines else []
    plan = policies.plan_of(config, algorithm)
    return policies.compiled_for([config], algorithm, jax.devices(), tasks, plan)


def _learn_policy(run: OpenRun, program: policies.Compiled, params: Any) -> dict[str, Any]:
    """Runs all updates, chunk by chunk; saves the policy and returns the results."""
    config, algorithm = run.config, program.algorithm
    name, plan = config.run.algorithm, policies.plan_of(config, algorithm)
    total = plan.updates * plan.steps
    phase = run.progress.phase("learning the policy", total=total, unit="env steps")

    def row(done: int, found: Any) -> dict[str, Any]:
        metrics, scores = jax.tree.map(lambda x: x[0], found)
        count = plan.count(done - 1)
        means = _means({name: values[:count] for name, values in metrics.items()})
        shown = {"success in training": means["success"]}
        phase.update(plan.done(done) * plan.steps, **shown, reward=means["reward"])
        scored: dict[str, float] = {}
        if scores is not None and plan.examines(done - 1):
            # With deterministic actions, and with sampled ones: as many starts of either kind.
            scored["eval/episodes"] = algorithm.num_envs // 2
            for kind, values in scores._asdict().items():
                scored[f"eval/{kind}"], scored[f"eval/{kind}_sampled"] = map(float, values[0])
        return {**means, **scored}

    trained = policies.train(
        program, params, plan, config, name=name, run=run.dir, echo=run.echo, row=row
    )
    state = jax.tree.map(lambda x: x[0], trained.state)
    results = {"env_steps": total, "state_sha256": state_leaves.digest(state)}
    saved = run.dir.save_part("policy", total, algorithm.policy(state))
    stall = trained.stall_s
    run.dir.note_time(phase=name, compile_s=program.seconds, checkpoint_stall_s=stall)
    run.dir.finish_phase("policy", results, saved)
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
