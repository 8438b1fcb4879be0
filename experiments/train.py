"""Videos in, trained policy out: demonstrations, reward, policy, evaluation, report.

gril quickstart                    one block, about 4 minutes on two CPU cores
gril train match_regions           five blocks, sized for a GPU: see README for both results
gril train --resume RUN            go on with a run that was cut off
"""

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import checkpoint, report, run_dir, state_leaves, training_loop
from gril_jax.config import RunConfig
from gril_jax.progress import Progress
from gril_jax.reward import RewardParams
from gril_jax.rl.ppo import PPO, TrainState

from . import demonstrations, evaluate, setup
from . import pretrain as pretraining

__all__ = ["main"]

Echo = Callable[[str], None]


def main(config: RunConfig, *, resume: Path | None = None, echo: Echo = print) -> Path:
    """Run it, or go on with the run in a folder; returns the run's folder."""
    opened = {"device": setup.device_in_words(), "experiment": "train"}
    with run_dir.create_or_resume(config, resume, **opened) as run, Progress() as progress:
        echo(f"writing to {run.path}")
        env = setup.make_env(config.env, training=False)
        clock = _Clock()
        demos = demonstrations.gather_once(config, env, run, progress)
        clock.lap("demonstrations")
        reward_params, results = pretraining.learn(config, env, demos, run, progress, echo=echo)
        clock.lap("reward")
        algorithm = setup.make_ppo(config, setup.make_env(config.env, training=True))
        state, learned = _learn_policy(config, algorithm, reward_params, run, progress, echo)
        clock.lap("policy")
        policy = algorithm.policy(state)
        played = evaluate.play(config, env, policy, reward_params, run.path, progress)
        clock.lap("evaluation")
        results = results | learned | played | {"seconds": clock.seconds}
        run.finish(results)
        writing = progress.phase("writing the report", total=1, unit="pages", compiles=False)
        page = report.write_report(run.path)
        writing.update(1)
    echo(_summary(results, page))
    return run.path


class _Clock:
    """Seconds of each part, in this process."""

    def __init__(self):
        self.seconds: dict[str, float] = {}
        self._begun = time.monotonic()

    def lap(self, name: str) -> None:
        now = time.monotonic()
        self.seconds[name], self._begun = now - self._begun, now


def _learn_policy(
    config: RunConfig,
    algorithm: PPO,
    reward_params: RewardParams,
    run: run_dir.RunDir,
    progress: Progress,
    echo: Echo,
) -> tuple[TrainState, dict[str, Any]]:
    """Train the policy and save it; returns its state and results, which a run does once."""
    hyper = setup.ppo_hyper(config)
    key = jax.random.fold_in(jax.random.key(config.run.seed), 1)
    fresh = jax.jit(algorithm.init)(key, hyper)
    results = run.finished_phase("policy")
    if results is not None:
        return checkpoint.restore(
            run.path / "policy" / f"{results['env_steps']:012d}", fresh
        ), results
    state, results = _train_policy(
        config, algorithm, hyper, fresh, reward_params, run, progress, echo
    )
    shutil.rmtree(run.path / "policy", ignore_errors=True)  # of a process that was cut off here
    checkpoint.save(run.path / "policy", results["env_steps"], state)
    run.finish_phase("policy", results)
    return state, results


def _train_policy(
    config: RunConfig, algorithm: PPO, hyper, fresh, reward_params, run, progress, echo: Echo
) -> tuple[TrainState, dict[str, Any]]:
    """PPO in chunks of compiled updates."""
    chosen, per_chunk = config.ppo, config.run.updates_per_chunk
    per_update = chosen.num_envs * chosen.unroll_length
    updates = -(-chosen.num_timesteps // per_update)
    phase = progress.phase("learning the policy", total=updates * per_update, unit="env steps")
    begun = training_loop.restore(run, "ppo", fresh, tell=echo)
    started = time.monotonic()
    advance = _chunk_of_updates(algorithm, per_chunk, updates)
    advance = advance.lower(begun.state, hyper, reward_params).compile()
    compile_s = time.monotonic() - started
    phase.update(min(begun.chunks * per_chunk, updates) * per_update)

    def row(chunk, seconds, metrics):
        done = min(chunk * per_chunk, updates)
        made = done - (chunk - 1) * per_chunk
        found = _means({name: values[:made] for name, values in metrics.items()})
        steps = done * per_update
        phase.update(steps, success=found["success"], reward=found["reward"])
        return {**found, "env_steps": steps, "env_steps_per_s": steps / seconds}

    trained = training_loop.run_chunks(
        lambda state: advance(state, hyper, reward_params),
        begun,
        run=run,
        name="ppo",
        chunks=-(-updates // per_chunk),
        row=row,
        every_s=config.run.checkpoint_every,
        keep=config.run.keep_checkpoints,
    )
    return trained.state, {
        "env_steps": updates * per_update,
        "env_steps_per_s": updates * per_update / trained.seconds,
        "compile_s": compile_s,
        "checkpoint_stall_s": trained.stall_s,
        "state_sha256": state_leaves.digest(trained.state),
    }


def _chunk_of_updates(algorithm: PPO, per_chunk: int, updates: int):
    """`per_chunk` updates in one call, or what is left of all `updates`.

    How often the loop runs is no constant of the program: were it one, the compiler could unroll
    a short loop and round differently, and results would depend on where chunks end.
    """

    def advance(state, hyper, reward_params):
        def update(i, carry):
            state, rows = carry
            state, metrics = algorithm.step(state, hyper, reward_params)
            return state, jax.tree.map(lambda row, x: row.at[i].set(x), rows, metrics)

        shapes = jax.eval_shape(algorithm.step, state, hyper, reward_params)[1]
        rows = jax.tree.map(lambda x: jnp.zeros((per_chunk, *x.shape), x.dtype), shapes)
        count = jnp.minimum(per_chunk, updates - state.updates)
        return jax.lax.fori_loop(0, count, update, (state, rows))

    return jax.jit(advance, donate_argnums=0)


def _means(metrics: dict[str, np.ndarray]) -> dict[str, float]:
    """One chunk's updates in one row; success and score weigh each update by its episodes."""
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


def _summary(results: dict[str, Any], page: Path) -> str:
    return (
        f"success {results['success']:.1%} over {results['eval_episodes']} episodes "
        f"(actions drawn as in training {results['success_sampled']:.1%}, "
        f"random policy {results['success_random']:.1%}), "
        f"tau {results['tau']:.3f}, {results['env_steps_per_s']:,.0f} env steps/s\n"
        f"report: {page}"
    )
