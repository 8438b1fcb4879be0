"""Finished policies in every variant of their task, as they are: nothing is trained there.

In a variant other quantities are sampled at the start: places, colours, shapes, forces, the number
of blocks. Observations are padded, so that a policy can play all variants.

Shapes use K for policies, E for episodes and T for control steps.
"""

import dataclasses
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import Executor, Future
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gril_jax.compilation import ahead
from gril_jax.config import RunConfig
from gril_jax.demos.vision.video import write_video
from gril_jax.envs import Env, registry
from gril_jax.rl import evaluate, training
from gril_jax.rl.policy import Policy
from gril_jax.runs.checkpoints import checkpoint
from gril_jax.runs.run_dir import RunDir
from gril_jax.workflows.build import filming, policy_rewards, policy_setup, setup
from gril_jax.workflows.learning.encoders import stack

from . import saved
from .programs import Program
from .recipe import Study, changed
from .rewards import TrainedReward, reward_key
from .saved import Plan, Row, learns

DEMO = "demo"
_STARTS = 64  # of each variant


class Played(NamedTuple):
    """Last states of E episodes of each of K policies, and one video of each."""

    score: Float[Array, "K E"]
    success: Float[Array, "K E"]
    data: Any  # of the simulator in the first episode, leaves (K, T, ...)


class Ground(NamedTuple):
    """Compiled programs that play the policies of one task."""

    names: tuple[str, ...]  # of the variants, Demo first
    env: Env
    begun: Any  # episodes of all of them, leaves (E, ...)
    each: int
    play: Any  # (policies, their rewards, begun, key, deterministic) -> Played


def known(task: str) -> tuple[str, ...]:
    """The variants of a task, Demo first."""
    return tuple(registry.build(task, {}).variants)


def ground(
    config: RunConfig, policies: int, starts: int, *, wrap: Callable[[Env], Any] = lambda env: env
) -> Ground:
    """Compiles the evaluation of a row's policies, from so many starts of each variant; `wrap`
    makes of a task what the policies were trained in."""
    plain = _played_as(config)
    names = known(config.env.name)
    envs = {name: wrap(setup.make_env(config.env, training=False, variant=name)) for name in names}
    # Shapes, counts and forces are then data of each episode, and one program plays all of them.
    general = envs["all"]
    algorithm = policy_setup.make_algorithm(plain, general)
    begun = [
        evaluate.begin(
            dataclasses.replace(algorithm.episodes, env=envs[name]), jax.random.key(i),
            episodes=starts,
        )
        for i, name in enumerate(names)
    ]  # fmt: skip
    begun = jax.tree.map(lambda *x: jnp.concatenate(x), *begun)
    fresh = policy_setup.fresh_policy(plain, algorithm, jax.random.key(0))
    both = fresh, policy_rewards.blank(plain, general)
    like = jax.tree.map(lambda x: jnp.broadcast_to(x, (policies, *x.shape)), both)
    tau = config.pool.tau

    def play(policies, rewards, begun, key, deterministic):
        one = lambda pair: _played(algorithm, *pair, begun, key, deterministic, tau)  # noqa: E731
        return jax.lax.map(one, (policies, rewards))

    with ahead.tracing():
        lowered = jax.jit(play).lower(*like, begun, jax.random.key(0), jnp.asarray(True))
    return Ground(names, envs[DEMO], begun, starts, lowered.compile())


def _played_as(config: RunConfig) -> RunConfig:
    """The configuration without resets, and without a reward that its policy does not observe."""
    section = config.run.algorithm
    plain: dict[str, Any] = {f"{section}.{kind}_state_resets": 0.0 for kind in ("video", "visited")}
    if not policy_setup.policy_config(config).observe_gradient:
        plain["run.reward"] = "environmental"
    return changed(config, plain)


def figures(on: Ground, policies: Any, rewards: Any = ()) -> tuple[dict[str, list[float]], Played]:
    """The numbers of each policy by name, such as `score_jitter`, and its episodes.

    `rewards`, leaves (K, ...), are what they observe the gradient of."""
    key = jax.random.key(0)
    means = on.play(policies, rewards, on.begun, key, jnp.asarray(True))
    sampled = on.play(policies, rewards, on.begun, key, jnp.asarray(False))
    found: dict[str, list[float]] = {}
    for i, name in enumerate(on.names):
        part = slice(i * on.each, (i + 1) * on.each)
        for field in ("success", "score"):
            values = np.asarray(getattr(means, field))[:, part].mean(axis=1)
            found[f"{field}_{name}"] = values.tolist()
        found[f"worst_{name}"] = worst_tenth(np.asarray(means.score)[:, part]).tolist()
        values = np.asarray(sampled.success)[:, part].mean(axis=1)
        found[f"sampled_{name}"] = values.tolist()
    return found, means


def worst_tenth(score: Float[np.ndarray, "K E"]) -> Float[np.ndarray, "K"]:
    """The mean score of each policy's worst tenth of episodes, rounded up: their CVaR.

    >>> worst_tenth(np.array([[1.0, 0.0, 0.5] + [1.0] * 9])).tolist()
    [0.25]
    """
    return np.sort(score, axis=1)[:, : -(-score.shape[1] // 10)].mean(axis=1)


def _played(
    algorithm: training.Algorithm, policy: Policy, reward, begun, key, deterministic, tau
) -> Played:
    of, count = algorithm.episodes, len(begun.time)

    def one(episode, key):
        mean = algorithm.act(policy, episode, key, deterministic=True)
        drawn = algorithm.act(policy, episode, key, deterministic=False)
        action = jnp.where(deterministic, mean, drawn)
        return of.advance(reward, episode, action, tau=tau)[0]

    def move(running, key):
        running = jax.vmap(one)(running, jax.random.split(key, count))
        return running, jax.tree.map(lambda x: x[0], running.state.data)

    steps = jax.random.split(key, of.env.episode_length)
    last, data = jax.lax.scan(move, begun, steps)
    return Played(last.state.metrics["score"], last.state.metrics["success"], data)


def _like(config: RunConfig, policies: int) -> Policy:
    """Policies of the right shapes, to restore a checkpoint into."""
    algorithm = policy_setup.make_algorithm(config, setup.make_env(config.env, training=True))
    fresh = policy_setup.fresh_policy(config, algorithm, jax.random.key(0))
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (policies, *x.shape)), fresh)


# --- in a study


def get_ready(left: Sequence[Program], study: Study, pool: Executor) -> dict[str, Future[Ground]]:
    """Starts to compile, in a pool, what plays the policies of each program, by its name; nothing
    unless the study asks for it."""
    if "variants" not in study.measure:
        return {}
    starts = study.measure["variants"].get("starts", _STARTS)
    return {
        one.name: pool.submit(ground, one.rows[0].config, len(one.rows), starts) for one in left
    }


def finish(
    on: Ground,
    program: Program,
    plan: Plan,
    run: RunDir,
    rewards: Mapping[Hashable, TrainedReward],
) -> None:
    """Plays a program's policies; their numbers are the phase `variants-PROGRAM`, and a video of
    the best policy of each row goes to the study's folder `films`."""
    rows, folder = program.rows, saved.root(run.path) / "films"
    latest = checkpoint.latest(run.path / "policies" / program.name)
    policies = checkpoint.restore(latest, _like(rows[0].config, len(rows)))
    found, played = figures(on, policies, _rewards_of(rows, rewards))
    files = saved.row_files(run.path, [*plan.rows])
    best: dict[int, int] = {}
    for i, row in enumerate(rows):
        if found["score_demo"][i] > found["score_demo"][best.setdefault(row.cell, i)]:
            best[row.cell] = i
    folder.mkdir(exist_ok=True)
    for cell, i in best.items():
        data = jax.tree.map(lambda x, i=i: x[i], played.data)
        film = folder / files[[*plan.rows][cell]].with_suffix(".mp4").name
        write_video(film, filming.outlines(on.env, data), on.env.control_hz)
    of = [(row.cell, row.seed) for row in rows]
    known = {f"played_{name}": values for name, values in found.items()}
    known["played_starts"] = [on.each] * len(rows)
    run.finish_phase(f"variants-{program.name}", {"rows": of, "numbers": known})


def _rewards_of(rows: Sequence[Row], rewards: Mapping[Hashable, TrainedReward]) -> Any:
    """The parameters of the rewards that policies observe, leaves (K, ...). Where one could not be
    learned another is in its place: that policy counts for nothing."""
    keys = [reward_key(row.config) for row in rows]
    learned = [rewards[key] for key in keys if key in rewards]
    each = []
    for row, key in zip(rows, keys, strict=True):
        played = _played_as(row.config)
        known = rewards.get(key, learned[0]) if learns(played) else None
        of = (known.params, known.demos, known.num_classes) if known else (None, None, 0)
        each.append(policy_rewards.parameters(played, *of))
    return stack(each)
