"""Evaluates a trained policy: `gril eval RUN --episodes 256`, with `--film` also on video.

Success is counted over distinct starts, those of `evaluated_from`: perturbed initial states, and
held-out ones of a variant whose starts lie further away. If the task has a single nominal initial
state, the evaluation also says whether the policy succeeds from it.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from gril_jax.config import RunConfig
from gril_jax.demos.vision import video
from gril_jax.envs import Env
from gril_jax.envs.registry import Starts
from gril_jax.errors import DemoError
from gril_jax.report import rates
from gril_jax.rl.evaluate import Evaluation, evaluate
from gril_jax.rl.policy import Policy
from gril_jax.rl.training import Algorithm
from gril_jax.runs import run_dir
from gril_jax.runs.progress import Progress
from gril_jax.safe_files import writing
from gril_jax.workflows.build import filming, policy_rewards, policy_setup, setup, video_ends
from gril_jax.workflows.build.starts import Group, draw, evaluated_from, with_first


class Player(NamedTuple):
    """Episodes of a run to be played, by a compiled program that serves all of them."""

    algorithm: Algorithm
    reward_params: Any
    tau: float
    many: Group
    elsewhere: Group | None
    own: Group | None  # None if the task's own starts are `many`, or several

    def play(
        self, group: Group, policy: Policy, key: PRNGKeyArray, *, deterministic: bool
    ) -> Evaluation:
        """Plays a group's episodes, and behind them one from the task's own start."""
        begun = group.begun if self.own is None else with_first(group.begun, self.own.begun)
        means = jnp.asarray(deterministic)
        return evaluate(
            self.algorithm, policy, self.reward_params, begun, key, tau=self.tau,
            deterministic=means,
        )  # fmt: skip


def main(
    folder: Path,
    *,
    episodes: int = 256,
    seed: int = 0,
    variant: str | None = None,
    engine: str | None = None,
    film: bool = False,
    echo: Callable[[str], None] = print,
) -> dict[str, Any]:
    """Evaluates the policy of a finished run; returns what it prints. The folder is only read, but
    for eval.mp4, which `film` writes there."""
    config = run_dir.read_config(folder)
    if engine is not None:
        config = replace(config, env=replace(config.env, engine=engine))
    env = setup.make_env(config.env, training=False, variant=variant)
    policy = policy_setup.restore_policy(folder, config, policy_setup.make_algorithm(config, env))
    reward_params = policy_setup.policy_reward(folder, config, env)
    with Progress() as progress:
        phase = progress.phase("evaluating", total=1, unit="policies")
        found, means = rates_of(
            config, policy, reward_params, episodes=episodes, seed=seed, variant=variant
        )
        phase.update(1)
    for line in rates.sentences(found):
        echo(line)
    about = {name: float(getattr(means, name)[:episodes].mean()) for name in ("score", "reward")}
    numbers = "  ".join(f"{name} {value:.4f}" for name, value in about.items())
    echo(f"{numbers}  (means over the same episodes with deterministic actions)")
    found |= _beside_videos(folder, config, means, episodes, echo)
    if film:
        path = folder / "eval.mp4"
        with writing(folder):
            _film(env, means, reward_params, _shown(means, episodes), path)
        echo(f"video: {path} (the worst, the median and the best episode by return)")
    return found | about


def _beside_videos(
    folder: Path, config: RunConfig, means: Evaluation, episodes: int, echo: Callable[[str], None]
) -> dict[str, float]:
    """The share of episodes that end as the videos of the run do, where that can be told."""
    played = jax.tree.map(lambda x: x[:episodes], means.states.objects)
    try:
        ends = video_ends.of_run(folder, config, played)
    except DemoError as error:
        echo(f"how many end as its videos do is not known: {error}")
        return {}
    if ends is None:
        return {}
    echo(f"ends as its videos do: {ends:.1%} of these episodes, by their boxes alone")
    return {"ends_as_videos": ends}


def rates_of(
    config: RunConfig,
    policy: Policy,
    reward_params: Any,
    *,
    episodes: int,
    seed: int,
    variant: str | None = None,
    algorithm: Algorithm | None = None,
) -> tuple[dict[str, Any], Evaluation]:
    """The rates of a policy with what they count, as `results.json` has them, and its episodes with
    deterministic actions; `variant` is the one to begin in, None those of `evaluated_from`. The
    configuration's algorithm may be given: what is compiled for it serves again."""
    if algorithm is None:
        env = setup.make_env(config.env, training=False, variant=variant)
        algorithm = policy_setup.make_algorithm(config, env)
    key_begin, key_act = jax.random.split(jax.random.key(seed))
    among = evaluated_from(config.env)
    if variant is not None and among.own is not None:
        among = Starts(variant, variant, None)
    player = _player(config, algorithm, among, reward_params, key_begin, episodes)
    return _trained(player, policy, key_act)


def play(
    config: RunConfig,
    env: Env,
    policy: Policy,
    reward_params: Any,
    folder: Path,
    progress: Progress,
) -> dict[str, Any]:
    """Evaluates the trained policy beside an untrained one, and videos one episode."""
    phase = progress.phase("evaluating", total=2, unit="policies")
    keys = jax.random.split(jax.random.fold_in(jax.random.key(config.run.seed), 2), 3)
    key_begin, key_act = jax.random.split(keys[0])
    among, episodes = evaluated_from(config.env), config.run.eval_episodes
    algorithm = policy_setup.make_algorithm(config, env)
    player = _player(config, algorithm, among, reward_params, key_begin, episodes)
    found, means = _trained(player, policy, key_act)
    phase.update(1)
    # Through the host it loses its weak types, or the program would be compiled once more.
    untrained = jax.device_get(policy_setup.fresh_policy(config, algorithm, keys[1]))
    random = player.play(player.many, untrained, keys[2], deterministic=False)
    shown = _shown(means, episodes)
    _film(env, means, player.reward_params, shown, folder / "rollout.mp4")
    names = ("reward", "success", "score")
    arrays = {name: np.asarray(getattr(means, name))[:episodes] for name in names}
    np.savez(folder / "rollouts.npz", **arrays, shown=shown)
    phase.update(2)
    return found | {
        "score": float(means.score[:episodes].mean()),
        "success_random": player.many.share(random.success),
    }


def _player(
    config: RunConfig,
    algorithm: Algorithm,
    among: Starts,
    reward_params: Any,
    key: PRNGKeyArray,
    episodes: int,
) -> Player:
    """A player of so many episodes from each of these variants."""

    def drawn(variant: str | None, key: PRNGKeyArray) -> Group:
        return draw(config.env, variant, algorithm.episodes, key, count=episodes)

    many, elsewhere, own = drawn(among.many, key), None, None
    if among.elsewhere is not None:
        elsewhere = drawn(among.elsewhere, jax.random.fold_in(key, 1))
    if among.own != among.many:
        own = drawn(among.own, key)
        own = own if own.count == 1 else None
    return Player(algorithm, reward_params, config.pool.tau, many, elsewhere, own)


def _trained(
    player: Player, policy: Policy, key: PRNGKeyArray
) -> tuple[dict[str, Any], Evaluation]:
    """The rates of a trained policy as `results.json` has them, with what they count; and its
    episodes from many starts with deterministic actions."""
    many, elsewhere = player.many, player.elsewhere
    means = player.play(many, policy, key, deterministic=True)
    sampled = player.play(many, policy, key, deterministic=False)
    found: dict[str, Any] = {
        "success": many.share(means.success),
        "success_sampled": many.share(sampled.success),
        "success_ever": many.share(means.success_ever),
        "starts": many.count,
        "variant": many.variant,
        "eval_episodes": len(many.start),
    }
    remembered = means.remembered[: len(many.start)]
    if shares := policy_rewards.stages_finished(player.reward_params, remembered):
        found["stages_finished"] = shares
    if elsewhere is not None:
        there = player.play(elsewhere, policy, key, deterministic=True)
        found["elsewhere_success"] = elsewhere.share(there.success)
        found |= {"elsewhere_starts": elsewhere.count, "elsewhere_variant": elsewhere.variant}
    if player.own is not None:
        found["demo_solved"] = bool(means.success[-1] > 0.5)
    return found, means


def _shown(played: Evaluation, episodes: int) -> np.ndarray:
    """The worst, the median and the best episode by return."""
    returns = np.asarray(played.reward)[:episodes].sum(axis=1)
    order = np.argsort(returns, kind="stable")
    return order[[0, len(order) // 2, -1]]


def _film(env: Env, played: Evaluation, params: Any, shown: np.ndarray, path: Path) -> None:
    """Writes a video of three episodes side by side. A policy that sees its stage says which one it
    is at."""
    panels, episode = [], jax.jit(lambda states, at: jax.tree.map(lambda x: x[at], states))
    for one, kind in zip(shown, ("worst", "median", "best"), strict=True):
        film = filming.episode(env, episode(played.states, one))
        stages = policy_rewards.stages_in_words(params, played.remembered[one])
        words = [f"{kind}, {stage}" for stage in stages] or [kind] * len(film)
        panels.append(filming.with_captions(film, words))
    video.write_video(path, np.concatenate(panels, axis=2), env.control_hz)
