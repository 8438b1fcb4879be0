"""Evaluates a trained policy from the task's own starts: `gril eval RUN --episodes 100`."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.envs import Env
from gril_jax.experiments.pipeline import filming, policy_setup, setup

from gril_jax.config import RunConfig
from gril_jax.demos.vision import video
from gril_jax.rl.evaluate import Evaluation, evaluate
from gril_jax.rl.policy import Policy
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress


def main(
    folder: Path,
    *,
    episodes: int = 100,
    seed: int = 0,
    variant: str | None = None,
    echo: Callable[[str], None] = print,
) -> dict[str, float]:
    """Evaluates the policy of a finished run; the folder is only read."""
    config = run_dir.read_config(folder)
    env = setup.make_env(config.env, training=False, variant=variant)
    algorithm = policy_setup.make_algorithm(config, env)
    reward_params = policy_setup.policy_reward(folder, config, env)
    policy, key = policy_setup.restore_policy(folder, config, algorithm), jax.random.key(seed)
    tau = config.pool.tau
    found = evaluate(algorithm, policy, reward_params, key, tau=tau, episodes=episodes)
    numbers = _means(found, ("success", "success_ever", "score", "reward"))
    echo("  ".join(f"{name} {value:.4f}" for name, value in numbers.items()))
    return numbers


def play(
    config: RunConfig,
    env: Env,
    policy: Policy,
    reward_params: Any,
    folder: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Evaluates the trained policy beside an untrained one, and films one episode."""
    algorithm = policy_setup.make_algorithm(config, env)
    episodes = config.run.eval_episodes
    phase = progress.phase("evaluating", total=3 * episodes, unit="episodes")
    keys = jax.random.split(jax.random.fold_in(jax.random.key(config.run.seed), 2), 3)

    def run(policy: Policy, key, deterministic: bool) -> Evaluation:
        return evaluate(
            algorithm, policy, reward_params, key, tau=config.pool.tau, episodes=episodes,
            deterministic=jnp.asarray(deterministic),
        )  # fmt: skip

    trained = jax.block_until_ready(run(policy, keys[0], True))
    phase.update(episodes)
    # From one fixed start deterministic actions succeed always or never; sampled ones tell more.
    sampled = run(policy, keys[0], False)
    # Through the host it loses its weak types, or the program would be compiled once more.
    untrained = jax.device_get(policy_setup.fresh_policy(config, algorithm, keys[1]))
    random = run(untrained, keys[2], False)
    shown = int(np.argmax(np.asarray(trained.success)))  # the first success, if there is one
    film = filming.episode(env, jax.tree.map(lambda x: x[shown], trained.states))
    video.write_video(folder / "rollout.mp4", film, env.control_hz)
    arrays = {name: np.asarray(getattr(trained, name)) for name in ("reward", "success", "score")}
    np.savez(folder / "rollouts.npz", **arrays, shown=shown)
    phase.update(3 * episodes)
    return _means(trained, ("success", "success_ever", "score")) | {
        "success_sampled": float(sampled.success.mean()),
        "success_random": float(random.success.mean()),
        "eval_episodes": episodes,
    }


def _means(found: Evaluation, names: Sequence[str]) -> dict[str, float]:
    return {name: float(getattr(found, name).mean()) for name in names}
