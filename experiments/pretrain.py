"""Learn a reward from demonstration videos.

    gril pretrain quickstart           about a minute on two CPU cores
    gril pretrain --resume RUN         go on with a run that was cut off
    gril pretrain quickstart --hard-negatives RUN    learn from what RUN's policy was overpaid for

Writes a run folder with the demonstrations, the reward, and its profile along each of them.
"""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gril_jax import (
    checkpoint,
    report,
    reward,
    run_dir,
    state_leaves,
    subtasks,
    training_loop,
)
from gril_jax.audit_scene import Scene
from gril_jax.config import RunConfig
from gril_jax.demos import demo_batch
from gril_jax.progress import Progress
from gril_jax.reward import RewardParams

from . import cheats, demonstrations, learners, setup

__all__ = ["check_cheats", "learn", "main"]

Echo = Callable[[str], None]


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
        _, results = learn(config, env, demos, run, progress, policies=policies, echo=echo)
        run.finish(results)
    page = report.write_report(run.path)
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
) -> tuple[RewardParams, dict[str, Any]]:
    """Train the encoder, save the reward and its profiles; returns both, which a run does once.

    What the `policies` of earlier runs were overpaid for is learned from, too.
    """
    results = run.finished_phase("reward")
    if results is None:
        train = demos.batch("train")
        pool = cheats.gather_once(policies, config, train, run, progress, echo=echo)
        results = _learn(config, env, demos, pool, run, progress, echo)
        run.finish_phase("reward", results)
    # From the folder in any case: a resumed run has nothing else.
    blank = setup.blank_reward(config, len(env.classes))
    return checkpoint.restore(_folder(run) / f"{config.pretrain.steps:012d}", blank), results


def check_cheats(config: RunConfig, policies: Sequence[Any]) -> None:
    """Refuses policies (`cheats.Cheat`) to learn from where a reward of pictures is involved.

    Raises:
      ConfigError: the encoder of the run, or of one that they come from, takes pictures.
    """
    for each in (config, *(cheat.config for cheat in policies)) if policies else ():
        setup.require_boxes(each, "--hard-negatives, in the new run and in those that it names")


def _learn(
    config: RunConfig, env, demos, pool: Scene | None, run, progress: Progress, echo: Echo
) -> dict[str, Any]:
    learner, hyper = learners.learner(config, demos, pool), setup.pretrain_hyper(config)
    state = _train_encoder(config, learner, hyper, run, progress, echo)
    params = learner.reward(state, learner.data, hyper)
    shutil.rmtree(_folder(run), ignore_errors=True)  # of a process that was cut off right here
    checkpoint.save(_folder(run), config.pretrain.steps, params)
    measured = learner.measure(state, learner.data, hyper)
    _save_profiles(run.path, params, demos, hyper, learner)
    return {name: float(value) for name, value in measured.items()} | {
        "demonstrations": {split: len(names) for split, names in demos.names.items()},
        "trimmed_frames": demos.trimmed,
        "hard_negatives": 0 if pool is None else len(pool.label),
        "reward_sha256": state_leaves.digest(params),
        "state_sha256": state_leaves.digest(state),
    }


def _train_encoder(
    config: RunConfig, learner: learners.Learner, hyper, run, progress: Progress, echo: Echo
) -> Any:
    """All gradient steps, `updates` of the static configuration in a chunk."""
    updates = learner.static.updates
    phase = progress.phase("learning the reward", total=config.pretrain.steps)
    key = jax.random.fold_in(jax.random.key(config.run.seed), 0)
    fresh = learner.init(key, learner.data)

    def row(chunk, seconds, metrics):
        means = {name: float(value.mean()) for name, value in metrics._asdict().items()}
        phase.update(chunk * updates, loss=means["loss"])
        return {"step": chunk * updates, **means}

    return training_loop.run_chunks(
        lambda state: learner.step(state, learner.data, hyper),
        training_loop.restore(run, "pretrain", fresh, tell=echo),
        run=run,
        name="pretrain",
        chunks=config.pretrain.steps // updates,
        row=row,
        every_s=config.run.checkpoint_every,
        keep=config.run.keep_checkpoints,
    ).state


def _folder(run: run_dir.RunDir) -> Path:
    return run.path / "reward"


def _save_profiles(folder: Path, params: RewardParams, demos, hyper, learner) -> None:
    """The reward along every demonstration, with the ends of its stages marked."""
    owners = [(name, split) for split, names in demos.names.items() for name in names]
    # All in one batch: each length by itself would compile programs of its own.
    names = [name for name, _ in owners]
    batch = demo_batch(demos.demo_set, names)
    profiles = reward.latent_reward(params, learner.latents(params.encoder, names, hyper))
    last = jnp.asarray(batch.length)[:, None] - 1
    frames = jnp.arange(profiles.shape[1])
    # A trace that goes on standing where it ends has the same boundaries, and none after its end.
    profiles = jnp.take_along_axis(profiles, jnp.minimum(frames, last), axis=1)
    boundaries = jax.jit(jax.vmap(subtasks.transitions))(profiles)
    np.savez(
        folder / "profiles.npz",
        names=np.array([name for name, _ in owners]),
        split=np.array([split for _, split in owners]),
        length=np.asarray(batch.length, np.int32),
        reward=np.asarray(profiles, np.float32),
        transitions=np.asarray(boundaries & (frames <= last)),
    )
