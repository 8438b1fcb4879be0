"""Learns a reward from demonstration videos; saves it, its demonstrations and its profiles.

gril pretrain quickstart           about a minute on two CPU cores
gril pretrain --resume RUN         go on with a run that was cut off
gril pretrain quickstart --hard-negatives RUN    learn from states that RUN's reward overestimates
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from gril_jax import reward
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
from gril_jax.workflows.build import (
    demonstrations,
    hard_negatives,
    learners,
    own_task,
    setup,
    vocabulary,
)
from gril_jax.workflows.build.hard_negatives import EarlierPolicy, Echo

_STAGES = {"prominence": 0.125, "smoothing": 15}  # how ends of stages are found in each trace


class OpenRun(NamedTuple):
    """A run, with what every part of it needs."""

    config: RunConfig
    dir: run_dir.RunDir
    progress: Progress
    echo: Echo  # says what happens
    policies: Sequence[EarlierPolicy]  # that give hard negatives

    @property
    def path(self) -> Path:
        """The run's folder."""
        return self.dir.path


@contextlib.contextmanager
def opened(
    config: RunConfig, experiment: str, resume: Path | None, policies: Sequence[Path], echo: Echo
) -> Iterator[OpenRun]:
    """A new run of a verb, or the one in the folder `resume`, whose configuration it has, open.

    The policies are of runs that give hard negatives; a resumed run has noted its own. Raises
    ConfigError if one cannot be read, or if a reward of pictures is involved.
    """
    loaded = [hard_negatives.load(folder) for folder in policies]
    hard_negatives.require_boxes(config, loaded)
    known = {"device": setup.device_in_words(), "experiment": experiment}
    known["begun"] = hard_negatives.noted(loaded)
    with run_dir.create_or_resume(config, resume, **known) as run, Progress() as progress:
        for sentence in (f"writing to {run.path}", *run.said):
            echo(sentence)
        yield OpenRun(config, run, progress, echo, loaded)


def main(
    config: RunConfig,
    *,
    resume: Path | None = None,
    hard_negatives: Sequence[Path] = (),
    echo: Echo = print,
) -> Path:
    """Runs it, or goes on with the run in the folder `resume`; see `opened`. Returns its folder."""
    env = setup.task_of(config.env)
    if env is not None:
        own_task.require_demonstrations(config, env)
    if resume is None:
        demonstrations.require_usable(config, env)
    with opened(config, "pretrain", resume, hard_negatives, echo) as run:
        demos = demonstrations.gather_once(config, env, run.dir, run.progress)
        if env is None:
            words = vocabulary.of_set(demos.demo_set, config.env.name)
            echo(
                f"classes {', '.join(words.classes)}; lengths in {words.unit}, of which a frame "
                f"shows {words.half_extent:g} to each side; {words.fps:g} frames a second"
            )
        results = learn(run, demos)
        run.dir.finish(results)
    page = run_report.write_report(run.path)
    echo(f"Kendall's tau on held-out demonstrations: {results['tau']:.3f}; report: {page}")
    return run.path


def learn(run: OpenRun, demos: demonstrations.Demonstrations) -> dict[str, Any]:
    """Trains the encoder, saves the reward and its profiles, once in a run; returns the results.

    States that the rewards of earlier policies overestimated are learned from, too.
    """
    results = run.dir.finished_phase("reward")
    if results is not None:
        return results
    config = run.config
    pool = hard_negatives.gather_once(
        run.policies, config, demos.batch("train"), run.dir, run.progress, echo=run.echo
    )
    learner, hyper = learners.learner(config, demos, pool), setup.pretrain_hyper(config)
    key = jax.random.fold_in(jax.random.key(config.run.seed), 0)
    owners = [(name, split) for split in SPLITS for name in demos.names[split]]
    # All in one batch: each length by itself would compile programs of its own.
    films = learner.films([name for name, _ in owners])
    with ahead.compiling() as compilers:
        successes = len(owners) - len(demos.names["failure"])
        programs = compiled_for(config, learner, key, films, successes, hyper, compilers)
        data = learner.data
        fresh, step = programs["init"].result()(key, data), programs["step"].result()
        state = _train_encoder(
            run, learner.static.updates, fresh, lambda state: step(state, data, hyper)
        )
        params = programs["reward"].result()(state, data, hyper)
        measured = programs["measure"].result()(state, data, hyper)
        rewards, ends = programs["profiles"].result()(params, films, hyper)
    saved = checkpoint.save_part(run.path, "reward", config.pretrain.steps, params)
    np.savez(
        profiles := run.path / "profiles.npz",
        names=np.array([name for name, _ in owners]),
        split=np.array([split for _, split in owners]),
        length=np.asarray(films.length, np.int32),
        reward=np.asarray(rewards, np.float32),
        transitions=np.asarray(ends),  # True where stages end
    )
    results = {name: float(value) for name, value in measured.items()} | {
        "demonstrations": {split: len(names) for split, names in demos.names.items()},
        "trimmed_frames": demos.trimmed,
        "hard_negatives": 0 if pool is None else len(pool.label),
        "reward_sha256": state_leaves.digest(params),
        "state_sha256": state_leaves.digest(state),
    }
    run.dir.finish_phase("reward", results, [saved, profiles])
    return results


def compiled_for(
    config: RunConfig, learner: learners.Learner, key, films, successes: int, hyper, pool: Executor
) -> dict[str, Future[Any]]:
    """Programs of an encoder's training, being compiled: (state, data, hyper) -> ...

    But "init" is (key, data) -> state, "profiles" (reward, films, hyper) -> rewards, stage ends.
    """
    boxes = config.encoder.kind != "pixels"  # brief convolutions have not been measured
    begin = key, learner.data
    trained = jax.eval_shape(learner.init, *begin), learner.data, hyper

    def ready(function, args, *, brief=boxes):
        with ahead.tracing():
            lowered = jax.jit(function).lower(*args())
        return compiled(lowered, brief=brief)

    def profiles(params, films, hyper):
        latents = learner.latents(params.encoder, films, hyper)
        return _profiles(params, latents, films.length, successes=successes)

    def after_reward():
        return jax.eval_shape(learner.reward, *trained), films, hyper

    brief = boxes and setup.few_updates(config)
    return {  # in this order: the first ones take longest
        "step": pool.submit(ready, learner.step, lambda: trained, brief=brief),
        "init": pool.submit(ready, learner.init, lambda: begin),
        "profiles": pool.submit(ready, profiles, after_reward),
        "measure": pool.submit(ready, learner.measure, lambda: trained),
        "reward": pool.submit(ready, learner.reward, lambda: trained),
    }


def _train_encoder(run: OpenRun, updates: int, fresh: Any, step: Callable[[Any], Any]) -> Any:
    """Runs all gradient steps, `updates` of them in a chunk."""
    steps = run.config.pretrain.steps
    phase = run.progress.phase("learning the reward", total=steps)

    def row(chunk, seconds, metrics):
        means = {name: float(value.mean()) for name, value in metrics._asdict().items()}
        phase.update(chunk * updates, loss=means["loss"])
        return {"step": chunk * updates, **means}

    begun = loop.restore(run.dir, "pretrain", fresh, tell=run.echo)
    return loop.run_chunks(
        step, begun, run=run.dir, name="pretrain", chunks=steps // updates, row=row,
        every_s=run.config.run.checkpoint_every,
    ).state  # fmt: skip


def _profiles(
    params: RewardParams, latents: Float[Array, "B T D"], length: Int[Array, "B"], *, successes: int
) -> tuple[Float[Array, "B T"], Bool[Array, "B T"]]:
    """Rewards, padded with the last one of each demonstration, and the frames that end stages."""
    rewards = reward.latent_reward(params, latents)
    frames = jnp.minimum(jnp.arange(rewards.shape[1]), length[:, None] - 1)
    rewards = jnp.take_along_axis(rewards, frames, axis=1)
    return rewards, _stage_ends(rewards, length, successes=successes)


def _stage_ends(
    rewards: Float[Array, "B T"], length: Int[Array, "B"], *, successes: int
) -> Bool[Array, "B T"]:
    """Frames at which stages end: as the first demonstrations, the successes, agree on them.

    Of the others, which failed, it is what each shows by itself.
    """
    patience, agreed = agreement.agreed_stages(rewards[:successes], length[:successes], **_STAGES)
    failed = rewards[successes:], length[successes:]
    alone = agreement.each_alone(*failed, **_STAGES, patience=patience)
    ends = jnp.concatenate([agreed.frames, alone])
    return (ends[:, :, None] == jnp.arange(rewards.shape[1])).any(axis=1)
