"""Videos in, trained policy out: demonstrations, reward, policy, evaluation, report.

gril quickstart                    one block, about 4 minutes on two CPU cores
gril train match_regions           five blocks, sized for a GPU: see README for both results
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np

from gril_jax import checkpoint, report, run_dir
from gril_jax.config import RunConfig
from gril_jax.progress import Progress
from gril_jax.reward import RewardParams
from gril_jax.rl.ppo import PPO, Policy, TrainState

from . import demonstrations, evaluate, setup
from . import pretrain as pretraining

__all__ = ["main"]


def main(config: RunConfig, echo: Callable[[str], None] = print) -> Path:
    """Run it; returns the run's folder."""
    out = Path(config.run.out) if config.run.out else run_dir.default_path(config.run.seed)
    seconds: dict[str, float] = {}
    with (
        run_dir.create(out, config, device=setup.device_in_words()) as run,
        Progress() as progress,
    ):
        echo(f"writing to {out}")
        env = setup.make_env(config.env, training=False)
        begun = time.monotonic()
        demos = demonstrations.gather(config, env, run.path / "demos", progress)
        seconds["demonstrations"] = time.monotonic() - begun

        begun = time.monotonic()
        reward_params, results = pretraining.learn(config, env, demos, run, progress)
        seconds["reward"] = time.monotonic() - begun

        begun = time.monotonic()
        training = setup.make_env(config.env, training=True)
        algorithm = setup.make_ppo(config, training)
        state, speed = _learn_policy(config, algorithm, reward_params, run, progress)
        results |= speed
        seconds["policy"] = time.monotonic() - begun

        begun = time.monotonic()
        policy = Policy(state.normalizer, state.params.policy)
        results |= evaluate.play(config, env, policy, reward_params, run.path, progress)
        seconds["evaluation"] = time.monotonic() - begun
        run.finish(results | {"seconds": seconds})
        writing = progress.phase("writing the report", total=1, unit="pages", compiles=False)
        page = report.write_report(out)
        writing.update(1)
    echo(_summary(results, page))
    return out


def _learn_policy(
    config: RunConfig,
    algorithm: PPO,
    reward_params: RewardParams,
    run: run_dir.RunDir,
    progress: Progress,
) -> tuple[TrainState, dict[str, Any]]:
    """PPO in chunks of compiled updates; logs and saves between them."""
    hyper, chosen = setup.ppo_hyper(config), config.ppo
    key = jax.random.fold_in(jax.random.key(config.run.seed), 1)
    state = jax.jit(algorithm.init)(key, hyper)

    def advance(state, hyper, reward_params):
        def update(state, _):
            return algorithm.step(state, hyper, reward_params)

        return jax.lax.scan(update, state, length=config.run.updates_per_chunk)

    advance = jax.jit(advance, donate_argnums=0)
    per_chunk = chosen.num_envs * chosen.unroll_length * config.run.updates_per_chunk
    chunks = -(-chosen.num_timesteps // per_chunk)
    phase = progress.phase("learning the policy", total=chunks * per_chunk, unit="env steps")
    begun = time.monotonic()
    advance = advance.lower(state, hyper, reward_params).compile()
    compile_s, begun = time.monotonic() - begun, time.monotonic()
    phase.begin()
    for chunk in range(1, chunks + 1):
        state, metrics = advance(state, hyper, reward_params)
        row = _means(jax.device_get(metrics))
        elapsed = time.monotonic() - begun
        row |= {"env_steps": chunk * per_chunk, "seconds": elapsed}
        row["env_steps_per_s"] = row["env_steps"] / elapsed
        run.log(phase="ppo", **row)
        phase.update(row["env_steps"], success=row["success"], reward=row["reward"])
    checkpoint.save(run.path / "policy", chunks * per_chunk, state)
    return state, {
        "env_steps": row["env_steps"],
        "env_steps_per_s": row["env_steps_per_s"],
        "compile_s": compile_s,
    }


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
