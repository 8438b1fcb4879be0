"""Trains a policy from videos: demonstrations, reward, policy, evaluation, report.

gril quickstart                    one block, 3 to 6 minutes on two CPU cores
gril train match_regions           five blocks, sized for a GPU: see README for both results
gril train match_regions --reward FILE|RUN    on a reward that exists: no encoder is trained
gril train --resume RUN            go on with a run that was cut off
gril train quickstart --hard-negatives RUN    learn from states that RUN's reward overestimates
"""

import time
from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any, NamedTuple

import jax

from gril_jax import envs
from gril_jax.compilation import ahead, sharding
from gril_jax.config import RunConfig
from gril_jax.config.tables import REWARDS
from gril_jax.errors import ConfigError
from gril_jax.report import rates, run_report
from gril_jax.report.headline import audit_kept, audit_sentence, in_words
from gril_jax.reward.learned_reward import LearnedReward
from gril_jax.rl import training
from gril_jax.runs import places
from gril_jax.runs.checkpoints import state_leaves
from gril_jax.runs.reading import read_phases
from gril_jax.workflows import audit, evaluate, export_reward, pretrain
from gril_jax.workflows.build import demonstrations, policy_rewards, policy_setup, setup
from gril_jax.workflows.build.given import given
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
    config, reused = _reused(config, env, resume)
    needs = needs_of(config)
    if hard_negatives and not needs.encoder:
        raise ConfigError("--hard-negatives is given, but the run learns no reward from them")
    if config.run.audit and needs.reward:
        audit.require_possible(config)
    if needs.demos:
        demonstrations.require_usable(config, env, begun=resume is not None)
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
        demos = None
        if needs.demos:
            demos = demonstrations.gather_once(config, env, run.dir, run.progress)
        lap("demonstrations")
        results = pretrain.learn(run, demos) if needs.encoder else _kept(run, reused)
        reward_params = _policy_reward(run, env, demos)
        lap("reward")
        if program is not None:
            params = jax.tree.map(lambda x: x[None], reward_params)
            found = _learn_policy(run, algorithm, program, params)
        blank = policy_setup.fresh_policy(config, algorithm, jax.random.key(0))
        policy = run.dir.load_part("policy", blank)
        lap("policy")
        played = run.dir.finished_phase("evaluation")
        if played is None:
            played = evaluate.play(config, env, policy, reward_params, run.path, run.progress)
            run.dir.finish_phase("evaluation", played, [run.path / name for name in _PLAYED])
        lap("evaluation")
        audited = _audited(run) if needs.reward else {}
        results = results | found | played | audited | {"given": str(given(config))}
        lap("audit")
        run.dir.finish(results)
        speed = run.dir.metrics()[-1].get("env_steps_per_s") or 0.0
        writing = run.progress.phase("writing the report", total=1, unit="pages", compiles=False)
        page = run_report.write_report(run.path)
        writing.update(1)
    for line in (*rates.sentences(results), *([audit_sentence(results)] if needs.reward else [])):
        echo(line)
    echo(f"assistance: {results['given']}")
    tau = f"tau {results['tau']:.3f}, " if "tau" in results else ""
    took = in_words(time.monotonic() - begun)
    echo(f"{tau}{speed:,.0f} env steps/s, {took} in all\nreport: {page}")
    return run.path


class Needs(NamedTuple):
    """The parts of a run that its policy depends on."""

    reward: bool  # a learned one
    encoder: bool  # to be trained in this run
    demos: bool


def needs_of(config: RunConfig) -> Needs:
    """The parts that a configuration needs."""
    form = REWARDS[config.run.reward_form]
    encoder = form.learns and config.run.reward_source is None
    demos = encoder or form.staged or policy_rewards.begins_at_frames(config)
    return Needs(form.learns, encoder, demos)


def _reused(
    config: RunConfig, env: envs.Env, resume: Path | None
) -> tuple[RunConfig, LearnedReward | None]:
    """The configuration with the encoder of the reward that it names, and that reward, unless the
    run to resume holds it already."""
    source = config.run.reward_source
    if source is None or (resume and "reward" in read_phases(resume).finished):
        return config, None
    now = None if resume is None else places.find(resume, source, Path.exists)
    learned = export_reward.load_learned(now or Path(source))
    return export_reward.configured(config, learned, env, source), learned


def _kept(run: OpenRun, reused: LearnedReward | None) -> dict[str, Any]:
    """The results of a run that learns no reward; one that was learned before is kept in it."""
    results = run.dir.finished_phase("reward")
    if reused is None:
        return results or {}
    if results is None:
        digest = state_leaves.digest(reused.params)
        results = {"reward_from": run.config.run.reward_source, "reward_sha256": digest}
        run.dir.finish_phase("reward", results, run.dir.save_part("reward", 0, reused.params))
        run.echo(f"the reward is that of {results['reward_from']} (sha256 {digest[:12]})")
    return results


def _policy_reward(run: OpenRun, env: envs.Env, demos: demonstrations.Demonstrations | None) -> Any:
    """The policy reward's parameters, saved once beside the learned reward."""
    config, num_classes = run.config, len(env.classes)
    if run.dir.finished_phase("policy_reward") is None:
        learned = None
        if REWARDS[config.run.reward_form].learns:
            learned = run.dir.load_part("reward", setup.blank_reward(config, num_classes))
        shown = None if demos is None else demos.batch("train")
        params = policy_rewards.parameters(config, learned, shown, num_classes)
        saved = run.dir.save_part("policy_reward", config.pretrain.steps, params)
        run.dir.finish_phase("policy_reward", {}, saved)
        if said := policy_rewards.stages_note(config, params):
            run.echo(said)
    return run.dir.load_part("policy_reward", policy_rewards.blank(config, env))


def _audited(run: OpenRun) -> dict[str, Any]:
    """The audit of the learned reward, once in a run, where the configuration asks for one."""
    ascents = run.config.run.audit
    if not ascents:
        return {}
    found = run.dir.finished_phase("audit")
    if found is None:
        phase = run.progress.phase("auditing the reward", total=ascents, unit="searches")
        # It repeats to the byte, so what a process that was cut off left of it is written over.
        results = audit.main(run.path, ascents=ascents, seed=run.config.run.seed, echo=_silent)
        found = {"audit": audit_kept(results)}
        run.dir.finish_phase("audit", found)
        phase.update(ascents)
    return found


def _silent(line: str) -> None:
    """Says nothing: what an audit prints, the run says at its end."""


_PLAYED = ("rollout.mp4", "rollouts.npz")  # what `evaluate.play` writes


def compiled_for(config: RunConfig, algorithm: training.Algorithm) -> policies.Compiled:
    """The program of a policy's training; half of its environments play deterministic actions in
    evaluations."""
    tasks = policies.tasks_to_evaluate(config, algorithm)
    plan = policies.plan_of(config, algorithm)
    return policies.compiled_for([config], algorithm, jax.devices(), tasks, plan)


def _learn_policy(
    run: OpenRun, algorithm: training.Algorithm, ready: Future[policies.Compiled], params: Any
) -> dict[str, Any]:
    """Runs all updates, chunk by chunk; saves the policy and returns the results."""
    config = run.config
    name, plan = config.run.algorithm, policies.plan_of(config, algorithm)
    total, early = plan.updates * plan.steps, plan.least is not None
    phase = run.progress.phase("learning the policy", total=total, unit="env steps", at_most=early)
    program = ready.result()  # the phase shows that it compiles

    def row(done: int, found: Any) -> dict[str, Any]:
        line = {name: values[0] for name, values in policies.metrics_of(plan, done, found).items()}
        shown = {"success in training": line["success"]}
        phase.update(plan.done(done) * plan.steps, **shown, reward=line["reward"])
        return line

    trained = policies.train(
        program, params, plan, [config], name=name, run=run.dir, echo=run.echo, row=row,
        tick=lambda steps: phase.update(steps),
    )  # fmt: skip
    only = jax.jit(lambda trees: jax.tree.map(lambda x: x[0], trees))
    policy, state = only((trained.policy, trained.state))
    results = {"env_steps": trained.env_steps, "state_sha256": state_leaves.digest(state)}
    saved = run.dir.save_part("policy", trained.env_steps, policy)
    if early:
        results["policy_env_steps"] = trained.kept[0]
        run.echo(_ended(trained, plan))
    stall = trained.stall_s
    run.dir.note_time(phase=name, compile_s=program.seconds, checkpoint_stall_s=stall)
    run.dir.finish_phase("policy", results, saved)
    return results


def _ended(trained: policies.Learned, plan: policies.Plan) -> str:
    """Why a training without a fixed length ended, and which policy is kept."""
    steps = trained.env_steps
    why = "evaluations succeed, or no longer improve,"
    if steps >= plan.updates * plan.steps:
        why = "--max-steps is reached"
    return f"{why} after {steps:,} env steps: the best policy, of {trained.kept[0]:,}, is kept"
