"""Learn a reward from demonstration videos.

    gril pretrain quickstart           about a minute on two CPU cores
    gril pretrain --resume RUN         go on with a run that was cut off
    gril pretrain quickstart --hard-negatives RUN    learn from what RUN's policy was overpaid for

Writes a run folder with the demonstrations, the reward, and its profile along each of them.
"""

import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from gril_jax.experiments.pipeline import cheats, demonstrations, learners, setup
from jaxtyping import Array, Bool, Float, Int

from gril_jax import reward
from gril_jax.audit.scene_reward import Scene
from gril_jax.compilation import ahead
from gril_jax.compilation.compiler import compiled
from gril_jax.config import RunConfig
from gril_jax.report import run_report
from gril_jax.report.data import SPLITS
from gril_jax.reward.latent_goal import RewardParams
from gril_jax.runs import loop, run_dir
from gril_jax.runs.checkpoints import checkpoint, state_leaves
from gril_jax.runs.progress import Progress
from gril_jax.subtasks import agreement

__all__ = ["check_cheats", "learn", "learned", "main"]

Echo = Callable[[str], None]

_STAGES = {"prominence": 0.125, "smoothing": 15}  # how ends of stages are found in each trace


def main(
    config: RunConfig,
    *,
    resume: Path | None = None,
    hard_negatives: Sequence[Path] = (),
    echo: Echo = print,
) -> Path:
    """Run it, or go on with the run in a folder; returns the run's folder.

    Args:
      config: a resumed run's is its own.
      resume: its folder.
      hard_negatives: runs whose policies give them; a resumed run has noted its own.
      echo: says what happens.
    """
    policies = cheats.load(hard_negatives)
    check_cheats(config, policies)
    opened = {"device": setup.device_in_words(), "experiment": "pretrain"}
    begun = cheats.noted(policies)
    with (
        run_dir.create_or_resume(config, resume, begun=begun, **opened) as run,
        Progress() as progress,
    ):
        echo(f"writing to {run.path}")
        env = setup.make_env(config.env, training=False)
        demos = demonstrations.gather_once(config, env, run, progress)
        results = learn(config, env, demos, run, progress, policies=policies, echo=echo)
        run.finish(results)
    page = run_report.write_report(run.path)
    echo(f"Kendall's tau on held-out demonstrations: {results['tau']:.3f}; report: {page}")
    return run.path


def learn(
    config: RunConfig,
    env,
    demos: demonstrations.Demonstrations,
    run: run_dir.RunDir,
    progress: Progress,
    *,
    policies: Sequence[cheats.Cheat] = (),
    echo: Echo = print,
) -> dict[str, Any]:
    """Train the encoder, save the reward and its profiles, once in a run; returns the results.

    What the `policies` of earlier runs were overpaid for is learned from, too.
    """
    results = run.finished_phase("reward")
    if results is None:
        train = demos.batch("train")
        pool = cheats.gather_once(policies, config, train, run, progress, echo=echo)
        results = _learn(config, env, demos, pool, run, progress, echo)
        run.finish_phase("reward", results)
    return results


def learned(config: RunConfig, env, run: run_dir.RunDir) -> RewardParams:
    """The reward that a run has saved."""
    blank = setup.blank_reward(config, len(env.classes))
    return checkpoint.restore(_folder(run) / f"{config.pretrain.steps:012d}", blank)


def check_cheats(config: RunConfig, policies: Sequence[Any]) -> None:
    """Refuses policies (`cheats.Cheat`) to learn from where a reward of pictures is involved.

    Raises:
      ConfigError: the encoder of the run, or of one that they come from, takes pictures.
    """
    for each in (config, *(cheat.config for cheat in policies)) if policies else ():
        setup.require_boxes(each, "--hard-negatives, in the new run and in those that it names")


class _Programs(NamedTuple):
    """What trains an encoder and makes its reward, being compiled; (state, data, hyper) -> ..."""

    init: Future[Any]  # (key, data) -> state
    step: Future[Any]
    reward: Future[Any]
    measure: Future[Any]
    profiles: Future[Any]  # (reward, films, hyper) -> rewards, ends of stages


def _compiled(
    config: RunConfig, learner: learners.Learner, key, films, successes: int, hyper, pool: Executor
) -> _Programs:
    boxes = config.encoder.kind != "pixels"  # brief convolutions have not been measured
    data = learner.data
    state = jax.eval_shape(learner.init, key, data)

    def ready(function, args, *, brief=boxes):
        def make():
            with ahead.tracing():
                lowered = jax.jit(function).lower(*args())
            return compiled(lowered, brief=brief)

        return pool.submit(make)

    def profiles(params, films, hyper):
        latents = learner.latents(params.encoder, films, hyper)
        return _profiles(params, latents, films.length, successes=successes)

    def after_training():
        return state, data, hyper

    def after_reward():
        return jax.eval_shape(learner.reward, *after_training()), films, hyper

    return _Programs(  # in this order: the first ones take longest
        step=ready(learner.step, after_training, brief=boxes and setup.few_updates(config)),
        init=ready(learner.init, lambda: (key, data)),
        profiles=ready(profiles, after_reward),
        measure=ready(learner.measure, after_training),
        reward=ready(learner.reward, after_training),
    )


def _learn(
    config: RunConfig, env, demos, pool: Scene | None, run, progress: Progress, echo: Echo
) -> dict[str, Any]:
    learner, hyper = learners.learner(config, demos, pool), setup.pretrain_hyper(config)
    key = jax.random.fold_in(jax.random.key(config.run.seed), 0)
    owners = [(name, split) for split in SPLITS for name in demos.names[split]]
    # All in one batch: each length by itself would compile programs of its own.
    films = learner.films([name for name, _ in owners])
    with ahead.compiling() as compilers:
        successes = len(owners) - len(demos.names["failure"])
        programs = _compiled(config, learner, key, films, successes, hyper, compilers)
        data, updates = learner.data, learner.static.updates
        fresh, step = programs.init.result()(key, data), programs.step.result()
        state = _train_encoder(
            config, updates, fresh, lambda state: step(state, data, hyper), run, progress, echo
        )
        params = programs.reward.result()(state, data, hyper)
        measured = programs.measure.result()(state, data, hyper)
        profiles = programs.profiles.result()(params, films, hyper)
    shutil.rmtree(_folder(run), ignore_errors=True)  # of a process that was cut off right here
    checkpoint.save(_folder(run), config.pretrain.steps, params)
    _save_profiles(run.path, owners, films.length, profiles)
    return {name: float(value) for name, value in measured.items()} | {
        "demonstrations": {split: len(names) for split, names in demos.names.items()},
        "trimmed_frames": demos.trimmed,
        "hard_negatives": 0 if pool is None else len(pool.label),
        "reward_sha256": state_leaves.digest(params),
        "state_sha256": state_leaves.digest(state),
    }


def _train_encoder(
    config: RunConfig, updates: int, fresh: Any, step, run, progress: Progress, echo: Echo
) -> Any:
    """All gradient steps, `updates` of them in a chunk."""
    phase = progress.phase("learning the reward", total=config.pretrain.steps)

    def row(chunk, seconds, metrics):
        means = {name: float(value.mean()) for name, value in metrics._asdict().items()}
        phase.update(chunk * updates, loss=means["loss"])
        return {"step": chunk * updates, **means}

    return loop.run_chunks(
        step,
        loop.restore(run, "pretrain", fresh, tell=echo),
        run=run,
        name="pretrain",
        chunks=config.pretrain.steps // updates,
        row=row,
        every_s=config.run.checkpoint_every,
        keep=config.run.keep_checkpoints,
    ).state


def _folder(run: run_dir.RunDir) -> Path:
    return run.path / "reward"


def _save_profiles(folder: Path, owners, length, profiles) -> None:
    """The reward along every demonstration, with the ends of its stages marked."""
    rewards, ends = profiles
    np.savez(
        folder / "profiles.npz",
        names=np.array([name for name, _ in owners]),
        split=np.array([split for _, split in owners]),
        length=np.asarray(length, np.int32),
        reward=np.asarray(rewards, np.float32),
        transitions=np.asarray(ends),
    )


def _profiles(
    params: RewardParams, latents: Float[Array, "B T D"], length: Int[Array, "B"], *, successes: int
) -> tuple[Float[Array, "B T"], Bool[Array, "B T"]]:
    """Rewards, the last repeated behind a demonstration's end, and the frames that end stages."""
    rewards = reward.latent_reward(params, latents)
    frames = jnp.minimum(jnp.arange(rewards.shape[1]), length[:, None] - 1)
    rewards = jnp.take_along_axis(rewards, frames, axis=1)
    return rewards, _stage_ends(rewards, length, successes=successes)


def _stage_ends(
    rewards: Float[Array, "B T"], length: Int[Array, "B"], *, successes: int
) -> Bool[Array, "B T"]:
    """Frames at which stages end.

    The first demonstrations, as many as `successes`, agree on theirs; of the others, which failed,
    it is what each shows by itself.
    """
    good = rewards[:successes], length[:successes]
    failed = rewards[successes:], length[successes:]
    patience, agreed = agreement.agreed_stages(*good, **_STAGES)
    alone = agreement.each_alone(*failed, **_STAGES, patience=patience)
    ends = jnp.concatenate([agreed.frames, alone])
    return (ends[:, :, None] == jnp.arange(rewards.shape[1])).any(axis=1)
